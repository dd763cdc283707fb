/** What lies over the picture: the probe's frame, and the numbers in the pixels once there is room for them. */
import type { Frame } from '../frame/decode';
import { readPixelOf } from '../frame/reading';
import { percent, radiance } from '../numbers/format';
import type { Mode } from './painter';
import type { Size, View } from './view';

export interface Overlay {
  frame: Frame | null;
  image: Size;
  view: View;
  mode: Mode;
  density: number;
  probe: { x: number; y: number } | null;
  isPinned: boolean;
  accent: string;
}

/** CSS pixels per image pixel from which numbers are readable. */
const NUMBERS_FROM = 52;

export function drawOverlay(canvas: HTMLCanvasElement, overlay: Overlay): void {
  const context = canvas.getContext('2d');
  if (!context) return;
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (overlay.frame && overlay.view.zoom / overlay.density >= NUMBERS_FROM) drawNumbers(context, overlay, overlay.frame);
  if (overlay.probe) drawProbe(context, overlay, overlay.probe);
}

function drawProbe(context: CanvasRenderingContext2D, overlay: Overlay, probe: { x: number; y: number }): void {
  const { view, density } = overlay;
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

function drawNumbers(context: CanvasRenderingContext2D, overlay: Overlay, frame: Frame): void {
  const { view, image, density, mode } = overlay;
  const size = Math.min(11, view.zoom / density / 6) * density;
  context.font = `${size}px ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.lineJoin = 'round';
  context.lineWidth = 3 * density;
  context.strokeStyle = 'rgb(0 0 0 / 75%)';
  const first = { x: Math.max(0, Math.floor(-view.left / view.zoom)), y: Math.max(0, Math.floor(-view.top / view.zoom)) };
  const right = Math.min(image.width, Math.ceil((context.canvas.width - view.left) / view.zoom));
  const bottom = Math.min(image.height, Math.ceil((context.canvas.height - view.top) / view.zoom));
  for (let y = first.y; y < bottom; y++) {
    for (let x = first.x; x < right; x++) {
      const reading = readPixelOf(frame, x, y);
      const lines: [string, string][] =
        mode === 'error'
          ? [[reading.hasEstimate ? percent(reading.relative) : 'none', '#ffffff'], [radiance(reading.luminance), '#ffffff']]
          : [[radiance(reading.red), '#ff9d94'], [radiance(reading.green), '#9fe0a2'], [radiance(reading.blue), '#9ccbff']]; // prettier-ignore
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
