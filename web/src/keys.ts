/** The keyboard: one table that the handler obeys and the help shows. */
export type Action =
  | 'exposureUp' | 'exposureDown' | 'exposureReset' | 'normalise' | 'nextToneMap'
  | 'toggleError' | 'toggleDifference' | 'toggleTruth' | 'nextColours' | 'saveView' | 'copyView' | 'nextView' | 'onlyAbove' | 'showA' | 'showB' | 'swap' | 'wipe' | 'sideBySide'
  | 'drawRegion' | 'pauseOrResume' | 'fit' | 'actualSize' | 'zoomIn' | 'zoomOut'
  | 'probeLeft' | 'probeRight' | 'probeUp' | 'probeDown'
  | 'panLeft' | 'panRight' | 'panUp' | 'panDown'
  | 'pin' | 'unpin' | 'nextJob' | 'previousJob' | 'newRender' | 'undoDelete' | 'help'; // prettier-ignore

export interface Binding {
  action: Action;
  /** `event.key` values; a leading "Shift+" asks for the shift key. */
  keys: readonly string[];
  /** As printed in the help; bindings with the same text share a line. */
  shown: string;
  does: string;
  group: 'Picture' | 'View' | 'Compare' | 'Probe' | 'Page';
  /** Only while the viewer has the focus. */
  isForViewer?: boolean;
}

export const BINDINGS: readonly Binding[] = [
  { action: 'exposureUp', keys: ['e'], shown: 'e', does: 'half a stop brighter', group: 'Picture' },
  { action: 'exposureDown', keys: ['Shift+E'], shown: 'Shift E', does: 'half a stop darker', group: 'Picture' },
  { action: 'exposureReset', keys: ['r'], shown: 'r', does: 'exposure back to 0', group: 'Picture' },
  { action: 'normalise', keys: ['n'], shown: 'n', does: 'normalise: the brightest 1 % turn white', group: 'Picture' },
  { action: 'nextToneMap', keys: ['t'], shown: 't', does: 'next tone map', group: 'Picture' },
  { action: 'nextColours', keys: ['c'], shown: 'c', does: 'next false colours', group: 'Picture' },
  { action: 'saveView', keys: ['Shift+S'], shown: 'Shift S', does: 'save the view as PNG', group: 'Picture' },
  { action: 'copyView', keys: ['Shift+C'], shown: 'Shift C', does: 'copy the view', group: 'Picture' },
  { action: 'toggleError', keys: ['h'], shown: 'h', does: 'error map on or off', group: 'Picture' },
  { action: 'onlyAbove', keys: ['u'], shown: 'u', does: 'error map: only pixels above the target', group: 'Picture' },
  { action: 'nextView', keys: ['v'], shown: 'v', does: 'next view: image, error, samples, trust', group: 'Picture' },
  { action: 'showA', keys: ['1'], shown: '1', does: 'show A', group: 'Compare' },
  { action: 'showB', keys: ['2'], shown: '2', does: 'show B', group: 'Compare' },
  { action: 'swap', keys: ['x'], shown: 'x', does: 'swap A and B', group: 'Compare' },
  { action: 'wipe', keys: ['w'], shown: 'w', does: 'wipe between A and B', group: 'Compare' },
  { action: 'sideBySide', keys: ['s'], shown: 's', does: 'side by side', group: 'Compare' },
  { action: 'toggleDifference', keys: ['d'], shown: 'd', does: 'difference in standard errors', group: 'Compare' },
  { action: 'toggleTruth', keys: ['g'], shown: 'g', does: 'true error: A against B, which is the reference', group: 'Compare' },
  { action: 'fit', keys: ['f'], shown: 'f', does: 'fit the picture', group: 'View' },
  { action: 'actualSize', keys: ['0'], shown: '0', does: '100 %: one image pixel per screen pixel', group: 'View' },
  { action: 'zoomIn', keys: ['+', '='], shown: '+', does: 'zoom in (or the wheel)', group: 'View' },
  { action: 'zoomOut', keys: ['-'], shown: '-', does: 'zoom out', group: 'View' },
  { action: 'panLeft', keys: ['Shift+ArrowLeft'], shown: 'Shift arrows', does: 'pan (or drag)', group: 'View', isForViewer: true },
  { action: 'panRight', keys: ['Shift+ArrowRight'], shown: 'Shift arrows', does: 'pan (or drag)', group: 'View', isForViewer: true },
  { action: 'panUp', keys: ['Shift+ArrowUp'], shown: 'Shift arrows', does: 'pan (or drag)', group: 'View', isForViewer: true },
  { action: 'panDown', keys: ['Shift+ArrowDown'], shown: 'Shift arrows', does: 'pan (or drag)', group: 'View', isForViewer: true },
  { action: 'probeLeft', keys: ['ArrowLeft'], shown: 'arrows', does: 'move the probe', group: 'Probe', isForViewer: true },
  { action: 'probeRight', keys: ['ArrowRight'], shown: 'arrows', does: 'move the probe', group: 'Probe', isForViewer: true },
  { action: 'probeUp', keys: ['ArrowUp'], shown: 'arrows', does: 'move the probe', group: 'Probe', isForViewer: true },
  { action: 'probeDown', keys: ['ArrowDown'], shown: 'arrows', does: 'move the probe', group: 'Probe', isForViewer: true },
  { action: 'pin', keys: ['Enter'], shown: 'Enter', does: 'pin the probe (or click)', group: 'Probe', isForViewer: true },
  { action: 'unpin', keys: ['Escape'], shown: 'Esc', does: 'let the probe follow the pointer', group: 'Probe' },
  { action: 'drawRegion', keys: ['o'], shown: 'o', does: 'draw a region of interest', group: 'Probe' },
  { action: 'pauseOrResume', keys: ['p'], shown: 'p', does: 'pause or resume the job', group: 'Page' },
  { action: 'nextJob', keys: ['j'], shown: 'j', does: 'next job', group: 'Page' },
  { action: 'previousJob', keys: ['k'], shown: 'k', does: 'previous job', group: 'Page' },
  { action: 'newRender', keys: ['Shift+N'], shown: 'Shift N', does: 'new render', group: 'Page' },
  { action: 'undoDelete', keys: ['z'], shown: 'z', does: 'take a deleted job back, for ten seconds', group: 'Page' },
  { action: 'help', keys: ['?', 'Shift+?'], shown: '?', does: 'this help', group: 'Page' },
];

export interface KeyPress {
  key: string;
  shiftKey: boolean;
  ctrlKey: boolean;
  metaKey: boolean;
  altKey: boolean;
}

export interface KeyContext {
  /** The focus is in a field that takes text or keys of its own. */
  isTyping: boolean;
  isViewerFocused: boolean;
  /** The switch of WCAG 2.1.4: single keys act only while the viewer has the focus. */
  areSingleKeysOn: boolean;
}

export function actionFor(press: KeyPress, context: KeyContext): Action | null {
  if (context.isTyping || press.ctrlKey || press.metaKey || press.altKey) return null;
  if (!context.areSingleKeysOn && !context.isViewerFocused) return null;
  const name = press.shiftKey ? `Shift+${press.key}` : press.key;
  const binding = BINDINGS.find((entry) => entry.keys.includes(name) || entry.keys.includes(unshifted(name)));
  if (!binding || (binding.isForViewer && !context.isViewerFocused)) return null;
  return binding.action;
}

/** "+" needs Shift on many layouts. */
const unshifted = (name: string): string => (name === 'Shift++' ? '+' : name);

/** Lines of the help, one per distinct text, in groups. */
export function helpLines(): Map<string, { shown: string; does: string }[]> {
  const groups = new Map<string, { shown: string; does: string }[]>();
  for (const { group, shown, does } of BINDINGS) {
    const lines = groups.get(group) ?? [];
    if (!lines.some((line) => line.shown === shown && line.does === does)) lines.push({ shown, does });
    groups.set(group, lines);
  }
  return groups;
}
