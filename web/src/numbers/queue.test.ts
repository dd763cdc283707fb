import { expect, it } from 'vitest';
import { placesOf, waitInWords } from './queue';

const now = Date.parse('2026-01-01T00:00:00Z');
const at = (seconds: number): string => new Date(now + 1000 * seconds).toISOString();

it('a place is said with when it starts, if that can be told', () => {
  expect(waitInWords({ position: 3, expected_start: at(42) }, now)).toBe('3rd in the queue, starts in about 40\u00a0s');
  expect(waitInWords({ position: 2, expected_start: null }, now)).toBe('2nd in the queue');
  expect(waitInWords(null, now)).toBe('Waiting for its turn');
});

it('only the next one is about to start, and a time that has passed is not said', () => {
  expect(waitInWords({ position: 1, expected_start: at(0) }, now)).toBe('1st in the queue, about to start');
  expect(waitInWords({ position: 3, expected_start: at(0) }, now)).toBe('3rd in the queue');
  expect(waitInWords({ position: 1, expected_start: at(-30) }, now)).toBe('1st in the queue');
});

it('a told queue replaces all that was known', () => {
  const places = placesOf({ places: [{ id: 'b', position: 1, expected_start: null }] });
  expect([...places.keys()]).toEqual(['b']);
  expect(placesOf({ places: [] }).size).toBe(0);
});
