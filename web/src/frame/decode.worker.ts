/** Decodes frames away from the page's thread. One message in, one out, with the same id. */
import { decodeFrame } from './decode';

interface Scope {
  onmessage: ((event: MessageEvent<{ id: number; body: ArrayBuffer }>) => void) | null;
  postMessage(message: unknown, transfer: Transferable[]): void;
}
const scope = self as unknown as Scope;

scope.onmessage = ({ data }) => {
  try {
    const frame = decodeFrame(data.body);
    scope.postMessage({ id: data.id, frame }, [frame.halves.buffer]);
  } catch (cause) {
    scope.postMessage({ id: data.id, error: cause instanceof Error ? cause.message : String(cause) }, []);
  }
};
