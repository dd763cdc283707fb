/** What lies over the picture: the probe's frame, regions, names, and the numbers in the pixels once there is room for them. */
import type { Region } from '../api/types';
import type { Frame } from '../frame/decode';
import { readPixelOf, replicatesOf } from '../frame/reading';
import { percent, radiance } from '../numbers/format';
import type { HeldFrame, Mode, Pane } from './scene';
import type { Size, View } from './view';

export interface Overlay {
  size: Size;
  frames: readonly (HeldFrame | null)[];
  panes: readonly Pane[];
  /** "A" or "B" per pane where two are compared. */
  names: readonly string[];
  image: Size;
  view: View;
  mode: Mode;
  density: number;
  probe: { x: number; y: number } | null;
  isPinned: boolean;
  regions: readonly { box: Region | null; isFirm: boolean }[];
  accent: string;
}

/** CSS pixels per image pixel from which numbers are readable. */
const NUMBERS_FROM = 52;

export function drawOverlay(canvas: HTMLCanvasElement, overlay: Overlay): void {
  const context = canvas.getContext('2d', { willReadFrequently: true });
  if (!context) return;
  const { size, panes, names } = overlay;
  if (canvas.width !== size.width) canvas.width = size.width;
  if (canvas.height !== size.height) canvas.height = size.height;
  context.clearRect(0, 0, canvas.width, canvas.height);
  panes.forEach((pane, index) => {
    const { left, top, width, height } = pane.clip;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    const frame = overlay.frames.find((entry) => entry?.id === pane.frame);
    if (frame && pane.view.zoom / overlay.density >= NUMBERS_FROM) drawNumbers(context, overlay, pane, frame);
    // Probe and regions are counted in pixels of A.
    const relative = overlay.image.width / pane.image.width;
    const view = { ...pane.view, zoom: pane.view.zoom / relative };
    for (const { box, isFirm } of overlay.regions) if (box) drawRegion(context, overlay, view, box, isFirm);
    if (overlay.probe) drawProbe(context, overlay, view, overlay.probe);
    if (names[index]) drawName(context, overlay, pane, names[index]);
    context.restore();
  });
}

function drawName(context: CanvasRenderingContext2D, { density }: Overlay, { clip }: Pane, name: string): void {
  const side = 24 * density;
  // B's stands at the right edge: in a wipe the left one is under the handle.
  const left = name === 'A' ? clip.left + 8 * density : clip.left + clip.width - side - 8 * density;
  const top = clip.top + 8 * density;
  context.fillStyle = '#1f1f1f';
  context.fillRect(left, top, side, side);
  context.strokeStyle = name === 'A' ? '#5aa9ff' : '#c9a0ff';
  context.lineWidth = 2 * density;
  context.strokeRect(left, top, side, side);
  context.fillStyle = '#ffffff';
  context.font = `600 ${13 * density}px system-ui, sans-serif`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.fillText(name, left + side / 2, top + side / 2 + density);
}

function drawRegion(context: CanvasRenderingContext2D, { density, accent }: Overlay, view: View, box: Region, isFirm: boolean): void {
  const [x, y, width, height] = box;
  const left = Math.round(view.left) + x * view.zoom;
  const top = Math.round(view.top) + y * view.zoom;
  for (const [colour, thick] of [['#000000', 3.5], [isFirm ? '#e3b341' : accent, 1.5]] as const) {
    context.strokeStyle = colour;
    context.lineWidth = thick * density;
    context.setLineDash(isFirm ? [] : [6 * density, 4 * density]);
    context.strokeRect(left, top, width * view.zoom, height * view.zoom);
  }
  context.setLineDash([]);
}

function drawProbe(context: CanvasRenderingContext2D, overlay: Overlay, view: View, probe: { x: number; y: number }): void {
  const { density } = overlay;
  const side = Math.max(view.zoom, 9 * density);
  const left = Math.round(view.left) + (probe.x + 0.5) * view.zoom - side / 2;
  const top = Math.round(view.top) + (probe.y + 0.5) * view.zoom - side / 2;
  const strokes: [string, number][] = [['#000000', 3.5], [overlay.isPinned ? overlay.accent : '#ffffff', 1.5]]; // prettier-ignore
  for (const [colour, width] of strokes) {
    context.strokeStyle = colour;
    context.lineWidth = width * density;
    context.strokeRect(left, top, side, side);
  }
}

function drawNumbers(context: CanvasRenderingContext2D, { density, mode }: Overlay, { view, image, clip }: Pane, frame: Frame): void {
  const size = Math.min(11, view.zoom / density / 6) * density;
  context.font = `${size}px ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.lineJoin = 'round';
  context.lineWidth = 3 * density;
  context.strokeStyle = 'rgb(0 0 0 / 75%)';
  const from = { x: Math.floor((clip.left - view.left) / view.zoom), y: Math.floor((clip.top - view.top) / view.zoom) };
  const right = Math.min(image.width, Math.ceil((clip.left + clip.width - view.left) / view.zoom));
  const bottom = Math.min(image.height, Math.ceil((clip.top + clip.height - view.top) / view.zoom));
  for (let y = Math.max(0, from.y); y < bottom; y++) {
    for (let x = Math.max(0, from.x); x < right; x++) {
      const lines = linesIn(frame, mode, x, y);
      lines.forEach(([text, colour], line) => {
        const cx = view.left + (x + 0.5) * view.zoom;
        const cy = view.top + (y + 0.5) * view.zoom + (line - (lines.length - 1) / 2) * size * 1.3;
        context.strokeText(text, cx, cy);
        context.fillStyle = colour;
        context.fillText(text, cx, cy);
      });
    }
  }
}

function linesIn(frame: Frame, mode: Mode, x: number, y: number): readonly (readonly [string, string])[] {
  const reading = readPixelOf(frame, x, y);
  switch (mode) {
    case 'image':
      return [[radiance(reading.red), '#ff9d94'], [radiance(reading.green), '#9fe0a2'], [radiance(reading.blue), '#9ccbff']]; // prettier-ignore
    case 'error':
      return [[reading.hasEstimate ? percent(reading.relative) : 'none', '#ffffff'], [radiance(reading.luminance), '#ffffff']];
    case 'difference':
    case 'truth':
      return [[radiance(reading.luminance), '#ffffff']];
    case 'samples':
    case 'trust': {
      const found = replicatesOf(frame, x, y);
      if (!found) return [];
      const samples = [String(found.replicates * frame.header.replicate_size), '#ffffff'] as const;
      return mode === 'samples' ? [samples] : [[found.isTrusted ? 'trusted' : 'doubtful', found.isTrusted ? '#ffffff' : '#e3b341'], samples]; // prettier-ignore
    }
  }
}
