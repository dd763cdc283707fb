/**
 * Owns the picture's canvas: decodes frames, keeps their textures and draws, all away from the page's thread. Software
 * graphics wait for the whole screen to be put together before they answer; nobody notices here.
 */
import { agreement } from '../frame/agreement';
import { decodeFrame, type Frame } from '../frame/decode';
import { Painter } from './painter';
import type { FromWorker, Painting, ToWorker } from './scene';

interface Scope {
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
}
const scope = self as unknown as Scope;

/** Bodies as they came: small, enough to compare two frames, and to draw again after the graphics device was lost. */
const bodies = new Map<number, ArrayBuffer>();
let canvas: OffscreenCanvas | null = null;
let painter: Painter | null = null;
let last: Painting | null = null;
let nextFrame = 1;

function makePainter(): void {
  if (!canvas) return;
  try {
    painter = new Painter(canvas);
    for (const [id, body] of bodies) painter.keep(id, decodeFrame(body));
    if (last) painter.paint(last);
    scope.postMessage({ kind: 'ready', largestSide: painter.largestSide });
  } catch (cause) {
    painter = null;
    scope.postMessage({ kind: 'blind', reason: cause instanceof Error ? cause.message : 'WebGL2 is not available here' });
  }
}

function decode(job: number, body: ArrayBuffer): void {
  const frame: Frame = decodeFrame(body);
  const id = nextFrame++;
  bodies.set(id, body);
  painter?.keep(id, frame);
  const transfer = frame.counts ? [frame.halves.buffer, frame.counts.buffer] : [frame.halves.buffer];
  scope.postMessage({ kind: 'answer', job, value: { ...frame, id } }, transfer);
}

function compare(a: number, b: number): ReturnType<typeof agreement> {
  const [first, second] = [bodies.get(a), bodies.get(b)];
  return first && second ? agreement(decodeFrame(first), decodeFrame(second)) : null;
}

scope.onmessage = ({ data }) => {
  switch (data.kind) {
    case 'canvas':
      canvas = data.canvas;
      canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
      canvas.addEventListener('webglcontextrestored', makePainter);
      makePainter();
      break;
    case 'decode':
      try {
        decode(data.job, data.body);
      } catch (cause) {
        scope.postMessage({ kind: 'refused', job: data.job, error: cause instanceof Error ? cause.message : String(cause) });
      }
      break;
    case 'drop':
      bodies.delete(data.frame);
      painter?.drop(data.frame);
      break;
    case 'paint':
      last = data.painting;
      painter?.paint(last);
      scope.postMessage({ kind: 'painted' });
      break;
    case 'agree':
      scope.postMessage({ kind: 'answer', job: data.job, value: compare(data.a, data.b) });
      break;
  }
};
