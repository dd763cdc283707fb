import { expect, it } from 'vitest';
import { arrange, type Arrangement, otherView, portOf } from './layout';

const given: Arrangement = {
  size: { width: 1001, height: 400 }, density: 1, layout: 'single', view: { zoom: 2, left: 10, top: 5 }, wipeAt: 0.25, flipped: 'a',
  isJoint: false,
  a: { image: { width: 100, height: 50 }, frame: 1, target: 0.05, reduce: 2 },
  b: { image: { width: 200, height: 100 }, frame: 2, target: 0.01, reduce: 1 },
}; // prettier-ignore

it('a wipe cuts the viewer in two without a seam', () => {
  const [left, right] = arrange({ ...given, layout: 'wipe' });
  expect([left.frame, right.frame]).toEqual([1, 2]);
  expect(left.clip.width).toBe(250);
  expect(right.clip).toMatchObject({ left: 250, width: 751 });
});

it('side by side, both show the same part in halves of the same width', () => {
  const [left, right] = arrange({ ...given, layout: 'side' });
  const port = portOf(given.size, 'side', 1);
  expect(port).toEqual({ width: 499, height: 400, gap: 2 });
  expect(right.clip.left).toBe(left.clip.width + 2);
  expect(right.view.left - left.view.left).toBe(right.clip.left);
});

it('a picture of another size is shown over the same width', () => {
  expect(otherView(given.view, given.a.image, given.b.image).zoom * 200).toBe(given.view.zoom * 100);
});

it('a flip shows one, a difference waits for both', () => {
  expect(arrange({ ...given, layout: 'flip', flipped: 'b' }).map((pane) => pane.frame)).toEqual([2]);
  expect(arrange({ ...given, isJoint: true })[0].other).toBe(2);
  expect(arrange({ ...given, isJoint: true, b: { ...given.b, frame: null } })).toEqual([]);
});

it('two pictures are compared at one resolution, one alone is shown at its own', () => {
  for (const layout of ['wipe', 'side', 'flip'] as const)
    for (const pane of arrange({ ...given, layout, flipped: 'b' })) expect(pane.reduce).toBe(2);
  expect(arrange({ ...given, isJoint: true, a: given.b, b: given.a })[0].reduce).toBe(2);
  expect(arrange({ ...given, a: given.b, b: given.a })[0].reduce).toBe(1);
});
