/** Reads pictures from files and keeps their numbers, away from the page's thread. */
import { problemFrom } from '../api/problem';
import { bodyOf } from './body';
import type { FromFiles, PictureInfo, ToFiles } from './messages';
import { compare } from './metrics';
import { layersOf, FileError, type Raster } from './raster';
import { readPicture } from './read';
import { numbersIn } from './regions';

interface Scope {
  onmessage: ((event: MessageEvent<ToFiles>) => void) | null;
  postMessage(message: FromFiles, transfer?: Transferable[]): void;
}
const scope = self as unknown as Scope;
const rasters = new Map<string, Raster>();

function kept(key: string): Raster {
  const raster = rasters.get(key);
  if (!raster) throw new FileError('this picture is not open any more');
  return raster;
}

async function open(key: string, source: File | string): Promise<PictureInfo> {
  const raster = await readPicture(typeof source === 'string' ? await download(source) : await source.arrayBuffer());
  rasters.set(key, raster);
  const { width, height, attributes } = raster;
  return { width, height, attributes, layers: layersOf(raster.planes.keys()), hasErrors: raster.planes.has('stderr.Y') };
}

async function download(address: string): Promise<ArrayBuffer> {
  const response = await fetch(address);
  if (!response.ok) throw problemFrom(response.status, await response.text());
  return response.arrayBuffer();
}

async function answer(message: ToFiles): Promise<unknown> {
  switch (message.kind) {
    case 'open':
      return open(message.key, message.source);
    case 'close':
      return rasters.delete(message.key);
    case 'body':
      return bodyOf(kept(message.key), message.layer);
    case 'compare':
      return compare(kept(message.key), kept(message.reference));
    case 'region':
      return numbersIn(kept(message.key), message.region);
    case 'pixel': {
      const { planes, width } = kept(message.key);
      return [...planes].map(([name, plane]) => [name, plane[message.y * width + message.x]]);
    }
  }
}

scope.onmessage = ({ data }) => {
  answer(data).then(
    (value) => scope.postMessage({ job: data.job, value }, value instanceof ArrayBuffer ? [value] : []),
    (cause: unknown) => scope.postMessage({ job: data.job, error: cause instanceof Error ? cause.message : String(cause) }),
  );
};
