/** Where one picture or two lie in the viewer. Pure; all lengths in device pixels. */
import type { Pane } from './scene';
import type { Size, View } from './view';

export type Layout = 'wipe' | 'side' | 'flip';

/** Room for one picture; `gap` between two side by side. */
export interface Port extends Size {
  gap: number;
}

interface Shown {
  image: Size;
  frame: number | null;
  target: number;
  /** Of the frame, 1 where there is none. */
  reduce: number;
}

export interface Arrangement {
  size: Size;
  density: number;
  layout: Layout | 'single';
  view: View;
  wipeAt: number;
  flipped: 'a' | 'b';
  /** One picture made of both: a difference, or a true error. */
  isJoint: boolean;
  a: Shown;
  b: Shown;
}

export function portOf(size: Size, layout: Layout | 'single', density: number): Port {
  if (layout !== 'side') return { ...size, gap: 0 };
  const gap = Math.round(2 * density);
  return { width: Math.max(Math.floor((size.width - gap) / 2), 0), height: size.height, gap };
}

/** The view that shows picture `b` at the same place and width as picture `a`. */
export const otherView = (view: View, a: Size, b: Size): View => ({ ...view, zoom: (view.zoom * a.width) / b.width });

export function arrange({ size, density, layout, view, wipeAt, flipped, isJoint, a, b }: Arrangement): Pane[] {
  const whole = { left: 0, top: 0, width: size.width, height: size.height };
  // Two pictures are compared at the resolution of the coarser one: a finer one beside it would show false outlines.
  const reduce = layout === 'single' && !isJoint ? a.reduce : Math.max(a.reduce, b.reduce);
  const first: Pane = { clip: whole, view, image: a.image, frame: a.frame, target: a.target, other: isJoint ? b.frame : null, reduce };
  const second: Pane = { ...first, view: otherView(view, a.image, b.image), image: b.image, frame: b.frame, target: b.target };
  switch (layout) {
    case 'single':
      return isJoint && b.frame === null ? [] : [first];
    case 'flip':
      return [flipped === 'a' ? first : second];
    case 'wipe': {
      const at = Math.round(wipeAt * size.width);
      return [
        { ...first, clip: { ...whole, width: at } },
        { ...second, clip: { ...whole, left: at, width: size.width - at } },
      ];
    }
    case 'side': {
      const port = portOf(size, layout, density);
      const shift = port.width + port.gap;
      return [
        { ...first, clip: { ...whole, width: port.width } },
        {
          ...second,
          clip: { ...whole, left: shift, width: size.width - shift },
          view: { ...second.view, left: second.view.left + shift },
        },
      ];
    }
  }
}
