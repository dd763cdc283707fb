/** Where queued jobs stand, as the service tells it: all places at once, so that no two of them contradict each other. */
import type { Queue, QueuePlace } from '../api/messages';
import { ordinal, startsIn } from './format';

export type Place = Pick<QueuePlace, 'position' | 'expected_start'>;

export const placesOf = ({ places }: Queue): ReadonlyMap<string, Place> => new Map(places.map((place) => [place.id, place]));

/** Seconds after which a start that was expected and did not come is no longer spoken of. */
const LATE = 3;

export function waitInWords(place: Place | null, now: number): string {
  if (!place) return 'Waiting for its turn';
  const where = `${ordinal(place.position)} in the queue`;
  if (place.expected_start === null) return where;
  const seconds = (Date.parse(place.expected_start) - now) / 1000;
  const isSaid = seconds >= 2 || (place.position === 1 && seconds > -LATE);
  return isSaid ? `${where}, ${startsIn(seconds)}` : where;
}
