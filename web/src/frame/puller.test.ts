import { afterEach, beforeEach, expect, it, vi } from 'vitest';
import { decodeFrame } from './decode';
import { SLOW_TRANSFER_MS } from './link';
import { FramePuller } from './puller';
import { frameBody } from './sample';

interface Request {
  jobId: string;
  after: number;
  reduce: number;
  hasMaps: boolean;
  signal: AbortSignal;
  answer: (body: ArrayBuffer | null) => void;
  fail: (cause: Error) => void;
}

let requests: Request[];
let shown: string[];
let linkMilliseconds: number;
let bodyMilliseconds: number;
let puller: FramePuller;

const frame = (seq: number, reduce = 1): ArrayBuffer => frameBody({ seq, reduce }, [[0, 0, 0, 0]]);
const settle = async (): Promise<void> => void (await vi.advanceTimersByTimeAsync(0));

beforeEach(() => {
  vi.useFakeTimers();
  requests = [];
  shown = [];
  linkMilliseconds = bodyMilliseconds = 0;
  puller = new FramePuller({
    source: {
      pull: async (request, signal) => {
        const body = await new Promise<ArrayBuffer | null>((answer, fail) => requests.push({ ...request, signal, answer, fail }));
        return { frame: body && decodeFrame(body), linkMilliseconds, bodyMilliseconds };
      },
      drop: ({ header }) => shown.push(`dropped:${header.seq}`),
    },
    onFrame: (jobId, { header }) => shown.push(`${jobId}:${header.seq}`),
    onFailure: (jobId) => shown.push(`${jobId}:failed`),
  });
});
afterEach(() => vi.useRealTimers());

it('keeps one request under way and skips frames that were overtaken', async () => {
  puller.select('a');
  for (const seq of [1, 2, 3]) puller.announce('a', seq, false);
  expect(requests).toHaveLength(1);
  requests[0].answer(frame(1));
  await settle();
  expect(requests).toHaveLength(2);
  expect(requests[1].after).toBe(1);
  requests[1].answer(frame(3));
  await settle();
  expect(requests).toHaveLength(2);
  expect(shown).toEqual(['a:1', 'a:3']);
});

it('aborts when another job is selected and hands back what comes late', async () => {
  puller.select('a');
  puller.announce('a', 1, false);
  puller.select('b');
  expect(requests[0].signal.aborted).toBe(true);
  requests[0].answer(frame(1));
  await settle();
  puller.announce('a', 2, false);
  expect(shown).toEqual(['dropped:1']);
  puller.announce('b', 1, false);
  expect(requests[1].jobId).toBe('b');
});

/** Answers the newest request over a link that takes so long. */
async function answered(seq: number, milliseconds: number): Promise<void> {
  linkMilliseconds = bodyMilliseconds = milliseconds;
  const request = requests[requests.length - 1];
  request.answer(frame(seq, request.reduce));
  await settle();
}

it('a link that has recovered shows whole pictures again, the one at hand first', async () => {
  puller.select('a');
  puller.announce('a', 1, false);
  await answered(1, SLOW_TRANSFER_MS + 1);
  puller.announce('a', 2, false);
  await answered(2, 100); // a quarter of the bytes: a whole picture would take 400 ms
  expect(requests).toHaveLength(3);
  expect(requests[2]).toMatchObject({ reduce: 1, after: 0 });
  await answered(2, 400);
  puller.announce('a', 3, false);
  expect(requests[3].reduce).toBe(1);
});

it('what is asked for is what small pictures say of whole ones, latency counted once', async () => {
  puller.select('a');
  puller.announce('a', 1, false);
  await answered(1, SLOW_TRANSFER_MS + 1);
  puller.announce('a', 2, false);
  linkMilliseconds = 900;
  bodyMilliseconds = 100; // 800 ms until the first byte: 1.2 s for the whole
  requests[1].answer(frame(2, 2));
  await settle();
  expect(requests[2]).toMatchObject({ reduce: 1 });
});

it('a link that only seems fast is tried less and less often', async () => {
  puller.select('a');
  let whole = 0;
  for (let seq = 1; seq <= 40; seq++) {
    puller.announce('a', seq, false);
    const before = requests.length;
    await answered(seq, requests[before - 1].reduce === 1 ? SLOW_TRANSFER_MS + 1 : 100);
    if (requests.length > before) await answered(seq, SLOW_TRANSFER_MS + 1);
    whole = requests.filter((request) => request.reduce === 1).length;
  }
  expect(whole).toBeGreaterThan(2);
  expect(whole).toBeLessThan(10);
});

it('asks for 2×2 means on a slow link, and for the whole picture at the end', async () => {
  puller.select('a');
  puller.announce('a', 1, false);
  linkMilliseconds = bodyMilliseconds = SLOW_TRANSFER_MS + 1;
  requests[0].answer(frame(1));
  await settle();
  puller.announce('a', 2, false);
  expect(requests[1].reduce).toBe(2);
  requests[1].answer(frame(2, 2));
  await settle();
  puller.announce('a', 2, true);
  expect(requests[2]).toMatchObject({ reduce: 1, after: 0 });
  requests[2].answer(frame(2));
  await settle();
  expect(requests).toHaveLength(3);
});

it('tries again after a failure', async () => {
  puller.select('a');
  puller.announce('a', 1, true);
  requests[0].fail(new Error('gone'));
  await settle();
  expect(shown).toEqual(['a:failed']);
  await vi.advanceTimersByTimeAsync(2000);
  expect(requests).toHaveLength(2);
});

it('an empty answer is not asked for again', async () => {
  puller.select('a');
  puller.announce('a', 4, false);
  requests[0].answer(null);
  await settle();
  expect(requests).toHaveLength(1);
});

it('asks for the same frame again once maps are wanted, and only once', async () => {
  puller.select('a');
  puller.wantMaps(true);
  expect(requests).toHaveLength(0);
  puller.wantMaps(false);
  puller.announce('a', 3, true);
  requests[0].answer(frame(3));
  await settle();
  puller.wantMaps(true);
  expect(requests[1]).toMatchObject({ after: 0, hasMaps: true });
  requests[1].answer(frame(3));
  await settle();
  puller.wantMaps(false);
  puller.wantMaps(true);
  expect(requests).toHaveLength(2);
});
