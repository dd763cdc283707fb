import { expect, it } from 'vitest';
import { actionFor, BINDINGS, helpLines, type KeyContext, type KeyPress } from './keys';

const press = (key: string, shiftKey = false): KeyPress => ({ key, shiftKey, ctrlKey: false, metaKey: false, altKey: false });
const page: KeyContext = { isTyping: false, isViewerFocused: false, areSingleKeysOn: true };

it('tells exposure up from exposure down by Shift', () => {
  expect(actionFor(press('e'), page)).toBe('exposureUp');
  expect(actionFor(press('E', true), page)).toBe('exposureDown');
});

it('takes "+" and "?" with or without Shift', () => {
  expect(actionFor(press('+', true), page)).toBe('zoomIn');
  expect(actionFor(press('='), page)).toBe('zoomIn');
  expect(actionFor(press('?', true), page)).toBe('help');
});

it('leaves arrows to the page until the viewer has the focus', () => {
  expect(actionFor(press('ArrowLeft'), page)).toBeNull();
  expect(actionFor(press('ArrowLeft'), { ...page, isViewerFocused: true })).toBe('probeLeft');
  expect(actionFor(press('ArrowLeft', true), { ...page, isViewerFocused: true })).toBe('panLeft');
});

it('is silent while someone types, with a modifier, and where single keys are off', () => {
  expect(actionFor(press('e'), { ...page, isTyping: true })).toBeNull();
  expect(actionFor({ ...press('r'), ctrlKey: true }, page)).toBeNull();
  expect(actionFor(press('e'), { ...page, areSingleKeysOn: false })).toBeNull();
  expect(actionFor(press('e'), { ...page, areSingleKeysOn: false, isViewerFocused: true })).toBe('exposureUp');
});

it('gives no key to two actions, and shows every binding', () => {
  const keys = BINDINGS.flatMap((binding) => binding.keys);
  expect(new Set(keys).size).toBe(keys.length);
  const shown = [...helpLines().values()].flat().map((line) => line.does);
  for (const binding of BINDINGS) expect(shown).toContain(binding.does);
});
