import { expect, it } from 'vitest';
import { type Address, addressOf, hashOf } from './address';

const job: Address = { page: 'job', id: 'a b', mode: 'error', exposure: -1.5, against: 'c', layout: 'side' };

it('an address survives being written and read', () => {
  const addresses: Address[] = [
    job,
    { ...job, mode: 'image', exposure: 0, against: null, layout: 'wipe' },
    { page: 'learn', scene: 'cornell-box', pixel: { x: 0, y: 12 } },
    { page: 'learn', scene: null, pixel: null },
    { page: 'start' },
  ];
  for (const address of addresses) expect(addressOf(hashOf(address))).toEqual(address);
});

it('plain links are short', () => {
  expect(hashOf({ ...job, id: 'x', mode: 'image', exposure: 0, against: null })).toBe('#/jobs/x');
});

it('nonsense is the usual, not an error', () => {
  expect(addressOf('#/jobs/x?view=loud&ev=much&layout=heap')).toMatchObject({ mode: 'image', exposure: 0, layout: 'wipe' });
  expect(addressOf('#/jobs/%E0%A4')).toMatchObject({ page: 'job', id: '%E0%A4' });
  expect(addressOf('#/learn/box?x=1')).toMatchObject({ page: 'learn', pixel: null });
  expect(addressOf('')).toEqual({ page: 'start' });
});
