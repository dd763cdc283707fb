import { describe, expect, it } from 'vitest';
import { inferno } from './inferno';
import { fitView, panned, pixelAt, revealing, steppedZoom, ZOOM_MAX, zoomAbout } from './view';

const image = { width: 200, height: 100 };
const port = { width: 824, height: 600 };

describe('view', () => {
  it('fits the whole image, centred', () => {
    const view = fitView(image, port);
    expect(view).toEqual({ zoom: 4, left: 12, top: 100 });
    expect(pixelAt(view, image, 12, 100)).toEqual({ x: 0, y: 0 });
    expect(pixelAt(view, image, 811, 499)).toEqual({ x: 199, y: 99 });
    expect(pixelAt(view, image, 812, 300)).toBeNull();
  });

  it('keeps the pixel under the pointer while zooming', () => {
    const view = fitView(image, port);
    const near = zoomAbout(view, 16, 300, 250);
    expect(pixelAt(near, image, 300, 250)).toEqual(pixelAt(view, image, 300, 250));
    expect(zoomAbout(view, 1e9, 0, 0).zoom).toBe(ZOOM_MAX);
  });

  it('never pans the image out of sight', () => {
    const far = panned(fitView(image, port), 1e6, -1e6, image, port);
    expect(far.left).toBeLessThan(port.width);
    expect(far.top + image.height * far.zoom).toBeGreaterThan(0);
  });

  it('reveals a probe beyond the edge and leaves a visible one alone', () => {
    const near = zoomAbout(fitView(image, port), 32, 0, 0);
    const moved = revealing(near, image, port, 150, 50);
    expect(pixelAt(moved, image, moved.left + 150.5 * 32, moved.top + 50.5 * 32)).toEqual({ x: 150, y: 50 });
    expect(moved.left + 151 * 32).toBeLessThanOrEqual(port.width);
    expect(revealing(moved, image, port, 150, 50)).toBe(moved);
  });

  it('steps through 100 % in both directions', () => {
    expect(steppedZoom(0.83, 1)).toBe(1);
    expect(steppedZoom(1, 1)).toBeCloseTo(Math.SQRT2);
    expect(steppedZoom(1.3, -1)).toBe(1);
    expect(steppedZoom(1, -1)).toBeCloseTo(Math.SQRT1_2);
  });
});

it.each([
  [0, [0, 0, 4]], [1 / 9, [27, 12, 66]], [3 / 9, [120, 28, 109]], [5 / 9, [207, 68, 70]], [7 / 9, [251, 154, 6]], [1, [252, 255, 164]],
])('inferno at %f is close to the published table', (at, published) => {
  inferno(at).forEach((value, channel) => expect(Math.abs(value - published[channel])).toBeLessThan(12));
}); // prettier-ignore
