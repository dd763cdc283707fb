import { expect, it } from 'vitest';
import { efficiencyRatio, ratioInWords } from './efficiency';

const curve = (factor: number) => [1, 2, 4, 8].map((seconds) => ({ seconds, spp: seconds, error: factor / Math.sqrt(seconds) }));

it('half the error in the same time is four times the efficiency', () => {
  expect(efficiencyRatio(curve(0.1), curve(0.2))).toBeCloseTo(4);
  expect(efficiencyRatio(curve(0.1), [])).toBeNull();
});

it('is said from the better one’s side', () => {
  expect(ratioInWords(4)).toBe('A needs 4.0 times less render time than B for the same error.');
  expect(ratioInWords(1 / 12.4)).toBe('B needs 12 times less render time than A for the same error.');
  expect(ratioInWords(1.01)).toContain('about the same');
});
