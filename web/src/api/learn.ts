/** Requests of the Learn view. */
import { getJson } from './client';
import type { RunningMoments } from './messages';
import { problemFrom } from './problem';
import type { FirstVertex, Technique } from './types';

const path = (scene: string, rest: string, query: Record<string, string | number | boolean>): string =>
  `api/learn/${encodeURIComponent(scene)}${rest}?${new URLSearchParams(Object.entries(query).map(([key, value]) => [key, String(value)]))}`;

export const firstVertex = (scene: string, x: number, y: number, signal: AbortSignal): Promise<FirstVertex> =>
  getJson(path(scene, '', { x, y }), signal);

export const runningEstimate = (
  scene: string, x: number, y: number, technique: Technique, first: number, count: number, signal: AbortSignal,
): Promise<RunningMoments[]> => getJson(path(scene, '/samples', { x, y, technique, first, count }), signal); // prettier-ignore

/** Arriving radiance over the map of directions, as a frame's bytes. */
export async function incidentMap(
  scene: string, x: number, y: number, replicates: number, weighted: boolean, signal: AbortSignal,
): Promise<ArrayBuffer> {
  const response = await fetch(path(scene, '/incident', { x, y, replicates, weighted }), { signal });
  if (!response.ok) throw problemFrom(response.status, await response.text());
  return await response.arrayBuffer();
} // prettier-ignore
