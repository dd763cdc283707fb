/** Requests of the Learn view. */
import { getJson } from './client';
import type { Bounces, ExtremeRung, IntegralEstimate, IntegralRuns, KernelTrade, LightPaths, LightPoints, RunningMoments, Trade } from './messages';
import { problemFrom } from './problem';
import type { FirstVertex, Technique } from './types';

const path = (scene: string, rest: string, query: Record<string, string | number | boolean>): string =>
  `api/learn/${encodeURIComponent(scene)}${rest}?${new URLSearchParams(Object.entries(query).map(([key, value]) => [key, String(value)]))}`;

export const firstVertex = (scene: string, x: number, y: number, signal: AbortSignal): Promise<FirstVertex> =>
  getJson(path(scene, '', { x, y }), signal);

export const runningEstimate = (
  scene: string, x: number, y: number, technique: Technique, first: number, count: number, signal: AbortSignal, maxDepth?: number,
): Promise<RunningMoments[]> =>
  getJson(path(scene, '/samples', { x, y, technique, first, count, ...(maxDepth !== undefined && { max_depth: maxDepth }) }), signal); // prettier-ignore

/** The pixel's luminance by the number of reflections, of samples first … first + count. */
export const bounces = (scene: string, x: number, y: number, first: number, count: number, signal: AbortSignal): Promise<Bounces> =>
  getJson(path(scene, '/bounces', { x, y, first, count }), signal);

/** Paths from the pixel's centre, a few from number `first` on. */
export const lightPaths = (scene: string, x: number, y: number, first: number, signal: AbortSignal): Promise<LightPaths> =>
  getJson(path(scene, '/paths', { x, y, first }), signal);

/** n points on the scene's lights as seen from the pixel's surface. */
export const lightPoints = (scene: string, x: number, y: number, n: number, signal: AbortSignal): Promise<LightPoints> =>
  getJson(path(scene, '/light-points', { x, y, n }), signal);

/** Arriving radiance over the map of directions, as a frame's bytes; weighted: times f·cosθ. */
export const incidentMap = (
  scene: string, x: number, y: number, replicates: number, weighted: boolean, signal: AbortSignal,
): Promise<ArrayBuffer> => getBytes(path(scene, '/incident', { x, y, replicates, weighted }), signal); // prettier-ignore

/** f·cosθ over the map of directions. */
export const kernelMap = (scene: string, x: number, y: number, signal: AbortSignal): Promise<ArrayBuffer> =>
  getBytes(path(scene, '/kernel', { x, y }), signal);

/** What is measured together. */
export type TradeGroup = 'technique' | 'sampling' | 'depth';

/** Turn number `step` of measuring what settings cost; all that is known by then. */
export const tradeTurn = (scene: string, group: TradeGroup, seconds: number, step: number, signal: AbortSignal): Promise<Trade> =>
  getJson(path(scene, '/trade', { group, seconds, step }), signal);

export const kernelTurn = (scene: string, step: number, signal: AbortSignal): Promise<KernelTrade> => getJson(path(scene, '/kernels', { step }), signal);

/** Where a small picture of a scene is, rendered when it is asked for. */
export const pictureOf = (scene: string): string => `api/learn/${encodeURIComponent(scene)}/picture.png`;

/** Place number k on the ladder of an extreme. */
export const extremeRung = (name: string, k: number, signal: AbortSignal): Promise<ExtremeRung> => getJson(`api/extremes/${name}?k=${k}`, signal);

/** A function between two limits, and the density that points are drawn with. */
export interface Integral {
  f: string;
  a: number;
  b: number;
  density: string;
}

const query = (of: object): string => String(new URLSearchParams(Object.entries(of).map(([key, value]) => [key, String(value)])));

export const estimateIntegral = (of: Integral, n: number, seed: number, signal: AbortSignal): Promise<IntegralEstimate> =>
  getJson(`api/integral?${query({ ...of, n, seed })}`, signal);

export const integralRuns = (of: Integral, n: number, signal: AbortSignal): Promise<IntegralRuns> =>
  getJson(`api/integral/runs?${query({ ...of, n })}`, signal);

async function getBytes(path: string, signal: AbortSignal): Promise<ArrayBuffer> {
  const response = await fetch(path, { signal });
  if (!response.ok) throw problemFrom(response.status, await response.text());
  return await response.arrayBuffer();
}
