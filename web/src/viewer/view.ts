/**
 * Where the image lies in the viewport. All lengths in device pixels, so that 100 % is one image pixel on one
 * screen pixel whatever the display's density.
 */
export interface Size {
  width: number;
  height: number;
}

export interface View {
  /** Device pixels per image pixel. */
  zoom: number;
  /** Viewport position of the image's top left corner. */
  left: number;
  top: number;
}

export const ZOOM_MIN = 1 / 32;
export const ZOOM_MAX = 256;
const FIT_MARGIN = 12;

export function fitView(image: Size, port: Size): View {
  const margin = Math.min(FIT_MARGIN, port.width / 20, port.height / 20);
  const zoom = Math.min((port.width - 2 * margin) / image.width, (port.height - 2 * margin) / image.height);
  return centred(image, port, clampZoom(zoom));
}

export const centred = (image: Size, port: Size, zoom: number): View => ({
  zoom,
  left: (port.width - image.width * zoom) / 2,
  top: (port.height - image.height * zoom) / 2,
});

export const clampZoom = (zoom: number): number => Math.min(Math.max(zoom, ZOOM_MIN), ZOOM_MAX);

/** Zooms to `zoom` and keeps the image point under (x, y) where it is. */
export function zoomAbout(view: View, zoom: number, x: number, y: number): View {
  const next = clampZoom(zoom);
  const factor = next / view.zoom;
  return { zoom: next, left: x - (x - view.left) * factor, top: y - (y - view.top) * factor };
}

/** Moves the image, but never so far that none of it can be seen. */
export function panned(view: View, dx: number, dy: number, image: Size, port: Size): View {
  const keep = 32;
  const clamp = (at: number, length: number, room: number): number =>
    Math.min(Math.max(at, keep - length), room - keep);
  return {
    zoom: view.zoom,
    left: clamp(view.left + dx, image.width * view.zoom, port.width),
    top: clamp(view.top + dy, image.height * view.zoom, port.height),
  };
}

/** Image pixel under a viewport point, or null outside the image. */
export function pixelAt(view: View, image: Size, x: number, y: number): { x: number; y: number } | null {
  const column = Math.floor((x - Math.round(view.left)) / view.zoom);
  const row = Math.floor((y - Math.round(view.top)) / view.zoom);
  const isInside = column >= 0 && row >= 0 && column < image.width && row < image.height;
  return isInside ? { x: column, y: row } : null;
}

/** Pans just enough to bring an image pixel into sight. */
export function revealing(view: View, image: Size, port: Size, x: number, y: number): View {
  const edge = Math.min(24, port.width / 4, port.height / 4);
  const shift = (at: number, room: number): number => {
    if (at < edge) return edge - at;
    return at + view.zoom > room - edge ? room - edge - at - view.zoom : 0;
  };
  const dx = shift(view.left + x * view.zoom, port.width);
  const dy = shift(view.top + y * view.zoom, port.height);
  return dx || dy ? panned(view, dx, dy, image, port) : view;
}

/** Next zoom of the buttons: factors of √2 on the grid that contains 100 %. */
export function steppedZoom(zoom: number, direction: 1 | -1): number {
  const position = 2 * Math.log2(zoom);
  const next = direction > 0 ? Math.floor(position + 1.001) : Math.ceil(position - 1.001);
  return clampZoom(2 ** (next / 2));
}
