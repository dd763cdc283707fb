import { expect, it } from 'vitest';
import type { GalleryScene, Job } from './api/types';
import { asCurl, asPython } from './api/recipes';
import { problemFrom } from './api/problem';
import { carriedInWords, draftFrom, errorsOf, freshDraft, furtherTarget, picturesOf, resized, seriesOf, sizeOf, submissionOf, targetOf, withProportions, withScene, withSensor } from './submission';

const scene: GalleryScene = { name: 'cornell-box', title: 'Cornell box', teaches: '', width: 512, height: 512, thumbnail: '', has_lesson: true };
const draft = { ...freshDraft(), choice: { kind: 'gallery' as const, scene } };

it('sends what was typed and leaves out what was not', () => {
  expect(submissionOf({ ...draft, errorPercent: '2.5', width: '256' })).toEqual({
    scene: { gallery: 'cornell-box' },
    target: { error: 0.025, seconds: 60 },
    settings: { technique: 'mis', width: 256, height: 256, seed: 0 },
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

const asked = {
  ...job,
  priority: 3,
  target: { error: 0.04, seconds: null, spp: null, confidence: 0.99, share: 0.9, region: [1, 2, 3, 4] },
  settings: { ...job.settings, adaptive: false, colour: 'spectral', channels: ['albedo', 'normal'], seed: 5, max_depth: 4 },
} as unknown as Job; // prettier-ignore

it('a render asked for again is the one that was asked for, whatever the form does not show', () => {
  expect(submissionOf(draftFrom(asked, { kind: 'gallery', scene }))).toEqual({
    scene: { gallery: 'cornell-box' },
    target: { error: 0.04, confidence: 0.99, share: 0.9, region: [1, 2, 3, 4] },
    settings: { width: 64, height: 48, seed: 5, max_depth: 4, technique: 'mis', adaptive: false, colour: 'spectral', channels: ['albedo', 'normal'] },
    priority: 3,
  });
  expect(carriedInWords(draftFrom(asked, null))).toBe('colour spectral; priority 3');
  expect(carriedInWords(freshDraft())).toBe('');
});

it('a sensor is kept with its scene, and brings its own size', () => {
  const again = draftFrom({ ...asked, settings: { ...asked.settings, sensor: 1 } } as Job, { kind: 'gallery', scene });
  expect(submissionOf(again).settings).toMatchObject({ sensor: 1, colour: 'spectral' });
  const elsewhere = withScene(again, { kind: 'gallery', scene: { ...scene, name: 'plates' } });
  expect(submissionOf(elsewhere).settings).not.toHaveProperty('sensor');
  expect(submissionOf(elsewhere).settings).toMatchObject({ colour: 'spectral' });
  const side = withSensor(elsewhere, { index: 2, name: 'side', plugin: 'perspective', width: 64, height: 32 });
  expect(submissionOf({ ...side, width: '16' }).settings).toMatchObject({ sensor: 2, width: 16, height: 8 });
});

it('a camera and values for parameters are sent as typed, kept by a job asked for again, and gone with another scene', () => {
  const camera = { origin: '0, 1 5', target: '', up: '', fov: '35' };
  const typed = { ...draft, camera, parameters: { thickness: '0.01', tint: ' ' } };
  const sent = submissionOf(typed).settings;
  expect(sent).toMatchObject({ camera: { origin: [0, 1, 5], fov: 35 }, parameters: { thickness: '0.01' } });
  const settings = { ...job.settings, camera: { origin: [0, 1, 5], target: null, up: null, fov: 35 }, parameters: { thickness: '0.01' } };
  const again = draftFrom({ ...asked, settings } as Job, { kind: 'gallery', scene });
  expect(submissionOf(again).settings).toMatchObject({ camera: sent?.camera, parameters: sent?.parameters });
  expect(submissionOf(withSensor(again, { index: 1, name: '', plugin: 'perspective', width: 8, height: 8 })).settings).toMatchObject({ parameters: sent?.parameters });
  const elsewhere = submissionOf(withScene(again, { kind: 'gallery', scene: { ...scene, name: 'plates' } })).settings;
  expect(elsewhere).not.toHaveProperty('camera');
  expect(elsewhere).not.toHaveProperty('parameters');
  expect(errorsOf({ ...typed, camera: { ...camera, up: '0, 1', fov: '180' } })).toMatchObject({ 'camera.up': 'Three numbers: x, y, z.', 'camera.fov': 'Above 0 and below 180 degrees.' });
});

it('all sensors, and several values of parameters, are a series', () => {
  expect(seriesOf(draft)).toBeNull();
  const swept = { ...draft, parameters: { thickness: '0.01; 0.02', tint: '1, 0, 0', side: '1;2;' } };
  const all = [{ thickness: '0.01', side: '1' }, { thickness: '0.01', side: '2' }, { thickness: '0.02', side: '1' }, { thickness: '0.02', side: '2' }]; // prettier-ignore
  expect(seriesOf(swept)).toMatchObject({ sweep: all, settings: { parameters: { tint: '1, 0, 0' } } });
  expect(seriesOf(swept)).not.toHaveProperty('sensors');
  const every = { ...draft, sensor: 1, hasAllSensors: true };
  expect(seriesOf(every)).toMatchObject({ sensors: 'all' });
  expect(seriesOf(every)?.settings).not.toHaveProperty('sensor');
  expect([picturesOf(swept, 3), picturesOf({ ...swept, hasAllSensors: true }, 3), picturesOf(draft, 3)]).toEqual([4, 12, 1]);
});

it('continuing keeps how sure one wants to be, and of how many pixels', () => {
  expect(targetOf(furtherTarget(asked, null))).toMatchObject({ error: 0.019, confidence: 0.99, share: 0.9, region: [1, 2, 3, 4] });
  expect(targetOf({ ...furtherTarget(asked, null), hasError: false, hasSpp: true })).toEqual({ spp: 512 });
});

it('one side typed keeps the proportions of the scene', () => {
  const wide = { ...draft, choice: { kind: 'gallery' as const, scene: { ...scene, width: 640, height: 360 } } };
  expect(sizeOf({ ...wide, width: '320' })).toEqual({ width: '320', height: '180' });
  expect(sizeOf({ ...wide, height: '90' })).toEqual({ width: '160', height: '90' });
  expect(sizeOf({ ...wide, width: '1' })).toEqual({ width: '1', height: '1' });
  expect(sizeOf(wide)).toEqual({ width: '', height: '' });
  expect(submissionOf({ ...wide, width: '320' }).settings).toMatchObject({ width: 320, height: 180 });
  // Typed beyond the limits in the other direction is told, not sent.
  const tower = { ...draft, choice: { kind: 'gallery' as const, scene: { ...scene, width: 10, height: 1000 } } };
  expect(errorsOf({ ...tower, width: '300' })).toHaveProperty('height');
});

it('a size that is filled in changes in proportion until it is set free', () => {
  const again = draftFrom(job, { kind: 'gallery', scene });
  expect(resized(again, 'width', '128')).toMatchObject({ width: '128', height: '96' });
  expect(resized(resized(again, 'height', '12'), 'height', '24')).toMatchObject({ width: '32', height: '24' });
  expect(resized(again, 'width', '')).toMatchObject({ width: '', height: '' });
  expect(resized(again, 'width', 'wide')).toMatchObject({ width: 'wide', height: '48' });
  const free = resized(withProportions(again, false), 'width', '100');
  expect(free).toMatchObject({ width: '100', height: '48' });
  expect(sizeOf({ ...free, height: '' })).toEqual({ width: '100', height: '' });
  expect(resized(withProportions(free, true), 'height', '24')).toMatchObject({ width: '50', height: '24' });
});
