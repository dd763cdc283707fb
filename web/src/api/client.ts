/** Requests to the service. All addresses are relative to the page, and every call takes an AbortSignal. */
import type { FrameRequest } from '../frame/puller';
import { Problem, problemFrom } from './problem';
import type { ToneMap } from '../viewer/scene';
import type { GalleryScene, Job, PixelReading, Requirements, Series, SeriesSubmission, Submission, Target, UploadedScene } from './types';

export const jobPath = (id: string): string => `api/jobs/${encodeURIComponent(id)}`;
export const exrPath = (id: string): string => `${jobPath(id)}/image.exr`;
export const jsonPath = (id: string): string => jobPath(id);
export const pngPath = (id: string, exposure: number, tone: ToneMap, seq?: number): string =>
  `${jobPath(id)}/image.png?exposure=${exposure}&tone=${tone}${seq === undefined ? '' : `&seq=${seq}`}`;

export async function getJson<T>(path: string, signal?: AbortSignal): Promise<T> {
  const response = await fetch(path, { signal, headers: { accept: 'application/json' } });
  if (!response.ok) throw problemFrom(response.status, await response.text());
  return (await response.json()) as T;
}

export async function postJson<T>(path: string, body: unknown, signal?: AbortSignal): Promise<T> {
  const response = await fetch(path, {
    method: 'POST',
    signal,
    headers: { 'content-type': 'application/json', accept: 'application/json' },
    body: body === undefined ? undefined : JSON.stringify(body),
  });
  if (!response.ok) throw problemFrom(response.status, await response.text());
  return (await response.json()) as T;
}

export const listGallery = (signal?: AbortSignal): Promise<GalleryScene[]> => getJson('api/gallery', signal);
export const listScenes = (signal?: AbortSignal): Promise<UploadedScene[]> => getJson('api/scenes', signal);

/** The newest jobs, at most 1000, or those older than the job `before`; and how many there are in all. */
export const listJobs = (limit: number, before?: string, signal?: AbortSignal): Promise<{ jobs: Job[]; total: number }> =>
  getJson(`api/jobs?limit=${Math.min(limit, 1000)}${before === undefined ? '' : `&before=${encodeURIComponent(before)}`}`, signal);

export const getJob = (id: string, signal?: AbortSignal): Promise<Job> => getJson(jobPath(id), signal);
export const submitJob = (submission: Submission, signal?: AbortSignal): Promise<Job> =>
  postJson('api/jobs', submission, signal);
export const seriesZipPath = (id: string): string => `api/series/${encodeURIComponent(id)}/images.zip`;
export const submitSeries = (submission: SeriesSubmission, signal?: AbortSignal): Promise<Series> =>
  postJson('api/series', submission, signal);
export const cancelJob = (id: string): Promise<Job> => postJson(`${jobPath(id)}/cancel`, undefined);
export const pauseJob = (id: string): Promise<Job> => postJson(`${jobPath(id)}/pause`, undefined);
export const resumeJob = (id: string): Promise<Job> => postJson(`${jobPath(id)}/resume`, undefined);
export const continueJob = (id: string, target: Target): Promise<Job> => postJson(`${jobPath(id)}/continue`, { target });

/** isPageLeaving: the answer may come when the page is gone. */
export async function deleteJob(id: string, isPageLeaving = false): Promise<void> {
  const headers = { accept: 'application/json' };
  const response = await fetch(jobPath(id), { method: 'DELETE', headers, keepalive: isPageLeaving });
  if (!response.ok && response.status !== 404) throw problemFrom(response.status, await response.text());
}

export const galleryRequirements = (name: string, signal?: AbortSignal): Promise<Requirements> =>
  getJson(`api/gallery/${encodeURIComponent(name)}/requirements`, signal);

export const readPixel = (id: string, x: number, y: number, signal?: AbortSignal): Promise<PixelReading> =>
  getJson(`${jobPath(id)}/pixel?x=${x}&y=${y}`, signal);

/** Newest frame after `after`; 204 where there is none. */
export const framePath = ({ jobId, after, reduce, hasMaps }: FrameRequest): string =>
  `${jobPath(jobId)}/frames/latest?after=${after}&scale=${reduce}${hasMaps ? '&maps=1' : ''}`;

/** Sends a scene file. XMLHttpRequest because fetch still reports no upload progress. */
export function uploadScene(
  file: File,
  onProgress: (sentBytes: number, totalBytes: number) => void,
  signal: AbortSignal,
): Promise<UploadedScene> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open('POST', 'api/scenes');
    request.setRequestHeader('accept', 'application/json');
    request.upload.onprogress = (event) => onProgress(event.loaded, event.total);
    request.onload = () => {
      if (request.status >= 200 && request.status < 300) resolve(JSON.parse(request.responseText) as UploadedScene);
      else reject(problemFrom(request.status, request.responseText));
    };
    request.onerror = () =>
      reject(new Problem('Upload broken off', `${file.name} was not sent: the connection broke. Try again.`, 0));
    request.onabort = () => reject(new DOMException('upload cancelled', 'AbortError'));
    signal.addEventListener('abort', () => request.abort(), { once: true });
    const form = new FormData();
    form.append('file', file);
    request.send(form);
  });
}
