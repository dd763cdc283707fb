/**
 * Owns the picture's canvas: fetches and decodes frames, keeps their textures and draws, all away from the page's thread. Software
 * graphics wait for the whole screen to be put together before they answer; nobody notices here.
 */
import { problemFrom } from '../api/problem';
import { agreement } from '../frame/agreement';
import { decodeFrame, type Frame } from '../frame/decode';
import { Painter } from './painter';
import type { FromWorker, HeldFrame, Painting, ToWorker } from './scene';

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
    painter = new Painter(canvas, frameOf);
    for (const [id, body] of bodies) painter.keep(id, decodeFrame(body));
    if (last) painter.paint(last);
    scope.postMessage({ kind: 'ready', largestSide: painter.largestSide });
  } catch (cause) {
    painter = null;
    scope.postMessage({ kind: 'blind', reason: cause instanceof Error ? cause.message : 'WebGL2 is not available here' });
  }
}

const underWay = new Map<number, AbortController>();

async function pull(job: number, address: string): Promise<void> {
  const abort = new AbortController();
  underWay.set(job, abort);
  const asked = performance.now();
  try {
    // The browser undoes the content encoding.
    const response = await fetch(address, { signal: abort.signal });
    const answered = performance.now();
    if (!response.ok) throw problemFrom(response.status, await response.text());
    const body = response.status === 204 ? null : await response.arrayBuffer();
    const ended = performance.now();
    const [linkMilliseconds, bodyMilliseconds] = [ended - asked, ended - answered];
    const arrivedAt = performance.timeOrigin + performance.now();
    const frame = body && kept(body);
    const transfer = frame ? buffersOf(frame) : [];
    scope.postMessage({ kind: 'answer', job, value: { frame, linkMilliseconds, bodyMilliseconds, arrivedAt } }, transfer);
  } catch (cause) {
    scope.postMessage({ kind: 'refused', job, error: cause instanceof Error ? cause.message : String(cause) });
  } finally {
    underWay.delete(job);
  }
}

const buffersOf = ({ halves, counts }: Frame): Transferable[] => [halves.buffer, ...(counts ? [counts.buffer] : [])];

/** A picture that does not come from the service. */
function keep(job: number, body: ArrayBuffer): void {
  try {
    const frame = kept(body);
    scope.postMessage({ kind: 'answer', job, value: frame }, buffersOf(frame));
  } catch (cause) {
    scope.postMessage({ kind: 'refused', job, error: cause instanceof Error ? cause.message : String(cause) });
  }
}

/** The view as it is painted, as PNG. */
async function shoot(job: number): Promise<void> {
  try {
    if (!painter || !last) throw new Error('nothing is drawn yet');
    painter.paint(last);
    scope.postMessage({ kind: 'answer', job, value: await painter.shot(last) });
  } catch (cause) {
    scope.postMessage({ kind: 'refused', job, error: cause instanceof Error ? cause.message : String(cause) });
  }
}

function kept(body: ArrayBuffer): HeldFrame {
  const frame: Frame = decodeFrame(body);
  const id = nextFrame++;
  bodies.set(id, body);
  painter?.keep(id, frame);
  return { ...frame, id };
}

function frameOf(id: number): Frame | null {
  const body = bodies.get(id);
  return body ? decodeFrame(body) : null;
}

function compare(a: number, b: number): ReturnType<typeof agreement> {
  const [first, second] = [frameOf(a), frameOf(b)];
  return first && second ? agreement(first, second) : null;
}

scope.onmessage = ({ data }) => {
  switch (data.kind) {
    case 'canvas':
      canvas = data.canvas;
      canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
      canvas.addEventListener('webglcontextrestored', makePainter);
      makePainter();
      break;
    case 'pull':
      void pull(data.job, data.address);
      break;
    case 'keep':
      keep(data.job, data.body);
      break;
    case 'abort':
      underWay.get(data.job)?.abort();
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
    case 'shoot':
      void shoot(data.job);
      break;
    case 'agree':
      scope.postMessage({ kind: 'answer', job: data.job, value: compare(data.a, data.b) });
      break;
  }
};
