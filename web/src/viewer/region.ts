/** Regions of interest: drawn in the viewer, counted in image pixels. */
import type { Region } from '../api/types';
import type { Size, View } from './view';

interface Point {
  x: number;
  y: number;
}

/** The image pixels that a rectangle between two viewport points touches; null where that is none. */
export function boxOf(from: Point, to: Point, view: View, image: Size): Region | null {
  const span = (a: number, b: number, origin: number, length: number): [number, number] => {
    const low = Math.floor((Math.min(a, b) - Math.round(origin)) / view.zoom);
    const high = Math.ceil((Math.max(a, b) - Math.round(origin)) / view.zoom);
    const start = Math.min(Math.max(low, 0), length);
    return [start, Math.min(Math.max(high, 0), length) - start];
  };
  const [x, width] = span(from.x, to.x, view.left, image.width);
  const [y, height] = span(from.y, to.y, view.top, image.height);
  return width > 0 && height > 0 ? [x, y, width, height] : null;
}

export const regionInWords = ([x, y, width, height]: Region): string => `${width} × ${height} pixels at (${x}, ${y})`;
