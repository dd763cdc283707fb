import { expect, it } from 'vitest';
import type { Job, Progress } from '../api/types';
import { withJob, withList, withPoint, withProgress } from './fold';

function job(id: string, changes: Partial<Job> = {}): Job {
  return {
    id, name: id, scene: { gallery: 'cornell-box', id: null, name: 'Cornell box' }, priority: 0, expected_start: null, state: 'running', target: { error: 0.02 },
    settings: { width: 8, height: 8, seed: 0, max_depth: 8, technique: 'mis' },
    created_at: `2026-01-01T00:00:0${id}Z`, started_at: null, finished_at: null, error: 0.1, spp: 4, samples: 256, seconds: 1,
    frame_seq: 3, stopped_by: null, queue_position: null, forecast: null, share_within: null, share_trusted: null, invalid: 0,
    cause: null, warnings: [], ...changes,
  };
} // prettier-ignore

const progress = (changes: Partial<Progress>): Progress => ({ ...job('1'), ...changes });

it('keeps the newest job first', () => {
  const jobs = ['2', '1', '3'].reduce<Job[]>((list, id) => withJob(list, job(id)), []);
  expect(jobs.map((entry) => entry.id)).toEqual(['3', '2', '1']);
});

it('lets no late message revive an ended job or turn a frame back', () => {
  const ended = [job('1', { state: 'succeeded', frame_seq: 9 })];
  expect(withJob(ended, job('1'))[0].state).toBe('succeeded');
  expect(withProgress(ended, progress({ error: 0.5 }))[0].error).toBe(0.1);
  expect(withProgress([job('1')], progress({ frame_seq: 2, error: 0.5 }))[0].error).toBe(0.1);
  expect(withProgress([job('1')], progress({ frame_seq: 4, error: 0.05 }))[0].error).toBe(0.05);
});

it('a fresh list drops what the service no longer has', () => {
  expect(withList([job('1'), job('2')], [job('2'), job('3')], 2).map((entry) => entry.id)).toEqual(['3', '2']);
});

it('jobs beyond the end of a list that is not the whole are kept', () => {
  const known = ['1', '2', '3', '4'].map((id) => job(id));
  // 1 is older than what the list reaches; 2 lies within its reach and is gone.
  expect(withList(known, [job('4'), job('3')], 3).map((entry) => entry.id)).toEqual(['4', '3', '2', '1']);
  expect(withList(known, [job('4'), job('3'), job('1')], 4).map((entry) => entry.id)).toEqual(['4', '3', '1']);
  expect(withList(known, [job('4')], 1).map((entry) => entry.id)).toEqual(['4']);
});

it('a curve only grows with time, and only with a measured error', () => {
  const start = withPoint([], progress({ seconds: 1, error: 0.1 }));
  expect(withPoint(start, progress({ seconds: 1, error: 0.2 }))).toBe(start);
  expect(withPoint(start, progress({ seconds: 2, error: null }))).toBe(start);
  expect(withPoint(start, progress({ seconds: 2, error: 0.07 }))).toHaveLength(2);
  expect(withPoint(start, progress({ seconds: 2, error: 0.07, error_upper: 0.09 }))[1]).toEqual({ seconds: 2, spp: 4, error: 0.07, upper: 0.09 });
});
