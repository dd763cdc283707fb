import { expect, it } from 'vitest';
import type { GalleryScene } from './api/types';
import { asCurl } from './api/client';
import { problemFrom } from './api/problem';
import { errorsOf, freshDraft, submissionOf } from './submission';

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
