import { expect, it } from 'vitest';
import type { GalleryScene, Job } from './api/types';
import { asCurl, asPython } from './api/recipes';
import { problemFrom } from './api/problem';
import { errorsOf, freshDraft, furtherTarget, submissionOf, targetOf } from './submission';

const scene: GalleryScene = { name: 'cornell-box', title: 'Cornell box', teaches: '', width: 512, height: 512, thumbnail: '' };
const draft = { ...freshDraft(), choice: { kind: 'gallery' as const, scene } };

it('sends what was typed and leaves out what was not', () => {
  expect(submissionOf({ ...draft, errorPercent: '2.5', width: '256' })).toEqual({
    scene: { gallery: 'cornell-box' },
    target: { error: 0.025, seconds: 60 },
    settings: { technique: 'mis', width: 256, seed: 0 },
  });
});

it('names each bad field with its range', () => {
  const errors = errorsOf({ ...draft, errorPercent: '0', hasSpp: true, spp: '1.5', width: 'wide', seed: '-1' });
  expect(errors).toEqual({
    error: 'From 0.01 to 100 %.', spp: 'Type a whole number.', width: 'Type a number.', seed: expect.stringContaining('From 0 to'),
  }); // prettier-ignore
  expect(errorsOf(draft)).toEqual({});
});

it('asks for a scene and for at least one target', () => {
  const errors = errorsOf({ ...freshDraft(), hasError: false, hasSeconds: false });
  expect(Object.keys(errors).sort()).toEqual(['scene', 'target']);
});

it('finds the message for a field in a problem body', () => {
  const body = { title: 'Bad', detail: 'Bad settings', errors: [{ field: 'body.settings.seed', message: 'too large' }, { nonsense: 1 }] };
  const problem = problemFrom(422, JSON.stringify(body));
  expect(problem.forField('settings.seed')).toBe('too large');
  expect(problem.forField('target')).toBeNull();
  expect(problemFrom(502, '<html>').detail).toContain('502');
});

it('a job as curl carries only what is set', () => {
  const line = asCurl(
    {
      scene: { gallery: 'it’s', id: null }, target: { error: 0.02, seconds: null, spp: null },
      settings: { width: 8, height: 8, seed: 1, max_depth: null, technique: 'mis' },
    } as never,
    'http://host/prefix/',
  ); // prettier-ignore
  expect(line).toBe(
    `curl -sS http://host/prefix/api/jobs -H 'content-type: application/json' -d '{"scene":{"gallery":"it’s"},"target":{"error":0.02},"settings":{"width":8,"height":8,"seed":1,"technique":"mis"}}'`,
  );
});

it('a region is four whole numbers, and only counts with an error target', () => {
  expect(targetOf({ ...draft, region: '10, 20 64x48' }).region).toEqual([10, 20, 64, 48]);
  expect(targetOf({ ...draft, region: ' ' }).region).toBeUndefined();
  expect(targetOf({ ...draft, hasError: false, region: '10 20 64 48' }).region).toBeUndefined();
  for (const region of ['1 2 3', '1 2 0 4', '1.5 2 3 4', 'left']) expect(errorsOf({ ...draft, region })).toHaveProperty('region');
});

const job = {
  id: 'j', name: 'My room.zip', scene: { gallery: null, id: 'abc', name: 'My room.zip' }, state: 'succeeded', target: { error: 0.04, seconds: null, spp: null },
  settings: { width: 64, height: 48, seed: 0, max_depth: null, technique: 'mis' }, error: 0.038, seconds: 12, spp: 128,
} as unknown as Job; // prettier-ignore

it('continuing asks for half of the error reached', () => {
  expect(furtherTarget(job, [1, 2, 3, 4])).toMatchObject({ hasError: true, errorPercent: '1.9', hasSeconds: false, region: '1, 2, 3, 4' });
  // A target that was missed comes before a better one.
  expect(furtherTarget({ ...job, error: 0.05 } as Job, null)).toMatchObject({ errorPercent: '4' });
  expect(furtherTarget({ ...job, error: 0.2 } as Job, null)).toMatchObject({ errorPercent: '10' });
  const timed = furtherTarget({ ...job, target: { seconds: 10 } } as Job, null);
  expect(timed).toMatchObject({ hasError: false, hasSeconds: true, seconds: '48' });
});

it('recipes ask for the same render without what was left open', () => {
  const curl = asCurl(job, 'http://host:1/prefix/');
  expect(curl).toContain('http://host:1/prefix/api/jobs');
  expect(curl).toContain('{"scene":{"id":"abc"},"target":{"error":0.04},"settings":{"width":64,"height":48,"seed":0,"technique":"mis"}}');
  const python = asPython(job, 'http://host:1/prefix/');
  expect(python).toContain('SERVICE = "http://host:1/prefix/api/"');
  expect(python).toContain('"My-room.exr"');
});
