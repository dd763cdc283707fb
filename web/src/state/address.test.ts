import { expect, it } from 'vitest';
import { type Address, addressOf, hashOf } from './address';

const job: Address = { page: 'job', id: 'a b', mode: 'error', exposure: -1.5, against: 'c', layout: 'side' };

it('an address survives being written and read', () => {
  const addresses: Address[] = [
    job,
    { ...job, mode: 'image', exposure: 0, against: null, layout: 'wipe' },
    { page: 'learn', chapter: 'pixel', scene: 'cornell-box', pixel: { x: 0, y: 12 }, own: {} },
    { page: 'learn', chapter: 'equation', scene: 'cornell-box', pixel: { x: 0, y: 12 }, own: {} },
    { page: 'learn', chapter: 'equation', scene: null, pixel: null, own: {} },
    { page: 'learn', chapter: 'monte-carlo', scene: null, pixel: null, own: { f: 'x^2 + 1', n: '64' } },
    { page: 'start' },
  ];
  for (const address of addresses) expect(addressOf(hashOf(address))).toEqual(address);
});

it('plain links are short', () => {
  expect(hashOf({ ...job, id: 'x', mode: 'image', exposure: 0, against: null })).toBe('#/jobs/x');
});

it('a link to a pixel alone, as written before there were chapters, shows what its samples do', () => {
  expect(addressOf('#/learn/box?x=1&y=2')).toMatchObject({ chapter: 'pixel', pixel: { x: 1, y: 2 } });
  expect(hashOf({ page: 'learn', chapter: 'pixel', scene: 'box', pixel: { x: 1, y: 2 }, own: {} })).toBe('#/learn/box?x=1&y=2');
  expect(addressOf('#/learn')).toMatchObject({ chapter: 'equation', scene: null });
});

it('nonsense is the usual, not an error', () => {
  expect(addressOf('#/jobs/x?view=loud&ev=much&layout=heap')).toMatchObject({ mode: 'image', exposure: 0, layout: 'wipe' });
  expect(addressOf('#/jobs/%E0%A4')).toMatchObject({ page: 'job', id: '%E0%A4' });
  expect(addressOf('#/learn/box?x=1')).toMatchObject({ page: 'learn', pixel: null });
  expect(addressOf('')).toEqual({ page: 'start' });
});

it('carries how a picture is looked at, and leaves out what a cut link makes useless', () => {
  const look = {
    tone: 'filmic', map: 'cividis', range: [0.5, 20], isLog: true, layer: 'albedo', zoom: 2.5, at: { x: 31.25, y: 7 }, pixel: { x: 3, y: 4 }, region: [1, 2, 30, 40],
  } as const; // prettier-ignore
  const address = { page: 'job', id: 'abc', mode: 'image', exposure: 0, against: null, layout: 'wipe', look } as unknown as Address;
  const hash = '#/jobs/abc?layer=albedo&tone=filmic&map=cividis&range=0.5,20&log=1&zoom=2.5&at=31.25,7&px=3,4&region=1,2,30,40';
  expect(hashOf(address)).toBe(hash);
  expect(addressOf(hash)).toEqual(address);
  expect(addressOf('#/jobs/abc?zoom=2&at=1&px=3&region=1,2,0,4&range=5,1&map=jet&tone=x')).not.toHaveProperty('look');
});
