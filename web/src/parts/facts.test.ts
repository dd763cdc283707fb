import { expect, it } from 'vitest';
import { factsOf } from './facts';

it('shows whatever is there and leaves out what says nothing', () => {
  const facts = factsOf(
    { digest: 'x', shapes: { rectangle: 6, cube: 1 }, media: {}, max_depth: -1, memory_bytes: 4500, features: ['mis', 'depth'], later: 3.5, needs_time: false },
    (n) => `${n} B`,
  );
  expect(facts).toEqual([['shapes', '6 × rectangle, cube'], ['max depth', 'unlimited'], ['memory', '4500 B'], ['features', 'mis, depth'], ['later', '3.5']]); // prettier-ignore
});
