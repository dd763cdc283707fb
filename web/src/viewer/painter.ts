/** Draws pictures with WebGL2. Holds textures by frame, no view state: everything that decides a picture comes with the call. */
import type { Frame, FrameHeader } from '../frame/decode';
import { atReduction } from '../frame/reduce';
import { type ColourMap, texelsOf } from './colourmaps';
import { type Look, MODES, type Painting, type Pane, TONE_MAPS } from './scene';
import { fragmentFor, type Variant, VERTEX } from './shaders';
import type { Size } from './view';

const UNIFORMS = [
  'frame', 'inferno', 'counts', 'other', 'viewportHeight', 'corner', 'zoom', 'reduction', 'gain', 'unscale', 'floorSquared',
  'target', 'onlyAbove', 'density', 'hasCounts', 'replicateSize', 'samples', 'otherReduction', 'otherUnscale', 'shades', 'range',
] as const; // prettier-ignore
const UNITS = { frame: 0, inferno: 1, counts: 2, other: 3, shades: 4 } as const;

interface Held {
  header: FrameHeader;
  meanLuminance: number;
  picture: WebGLTexture;
  counts: WebGLTexture | null;
  /** The same as 2×2 means, made once it is compared with another that is. */
  halved?: Held;
}

/** More would not be told from the mean of these. */
const MOST_TAPS = 4;

interface Program {
  program: WebGLProgram;
  at: Record<(typeof UNIFORMS)[number], WebGLUniformLocation | null>;
}

export class Painter {
  private readonly gl: WebGL2RenderingContext;
  private readonly programs = new Map<string, Program>();
  private readonly held = new Map<number, Held>();
  private readonly maps = new Map<ColourMap, WebGLTexture>();
  private readonly nothing: WebGLTexture;

  /** frameOf: a frame that is kept, once more. Throws where WebGL2 is missing or the program does not link. */
  constructor(
    private readonly canvas: OffscreenCanvas,
    private readonly frameOf: (id: number) => Frame | null,
  ) {
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error('WebGL2 is not available here');
    this.gl = gl;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    texture(gl, UNITS.inferno, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, texelsOf('inferno'));
    this.nothing = texture(gl, UNITS.counts, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, 1, 1, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, new Uint16Array(1));
    this.warmUp();
  }

  /** Larger images are shown as a PNG instead. */
  get largestSide(): number {
    return this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
  }

  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  keep(id: number, frame: Frame): void {
    this.held.set(id, this.uploaded(frame));
  }

  private uploaded(frame: Frame): Held {
    const { gl } = this;
    const { width, height } = frame.header;
    const picture = texture(gl, UNITS.frame, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16UI, width, height, 0, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, frame.halves);
    let counts: WebGLTexture | null = null;
    if (frame.counts) {
      counts = texture(gl, UNITS.counts, gl.NEAREST);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, width, height, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, frame.counts);
    }
    return { header: frame.header, meanLuminance: frame.summary.meanLuminance, picture, counts };
  }

  drop(id: number): void {
    const held = this.held.get(id);
    this.held.delete(id);
    for (const one of [held, held?.halved]) {
      if (one) this.gl.deleteTexture(one.picture);
      if (one?.counts) this.gl.deleteTexture(one.counts);
    }
  }

  /** A frame in pixels of `reduce` × `reduce`, where it is kept. */
  private heldAt(id: number | null, reduce: number): Held | undefined {
    const held = id === null ? undefined : this.held.get(id);
    if (!held || id === null || held.header.reduce >= reduce) return held;
    const frame = held.halved ? null : this.frameOf(id);
    if (frame) held.halved = this.uploaded(atReduction(frame, reduce));
    return held.halved;
  }

  paint({ port, density, panes, look }: Painting): void {
    const { gl } = this;
    if (gl.isContextLost()) return;
    const { width, height } = this.grown(port);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, height - port.height, port.width, port.height);
    gl.clearColor(look.well[0], look.well[1], look.well[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const pane of panes) this.paintPane(pane, height, look, density);
  }

  private paintPane(pane: Pane, canvasHeight: number, look: Look, density: number): void {
    const { gl } = this;
    const frame = this.heldAt(pane.frame, pane.reduce);
    if (!frame) return;
    const other = this.heldAt(pane.other, pane.reduce) ?? frame;
    const { scale, reduce, replicate_size } = frame.header;
    const footprint = 1 / (pane.view.zoom * reduce);
    const corner = { left: Math.round(pane.view.left), top: Math.round(pane.view.top) };
    const shade = look.mode === 'image' ? look.shade : null;
    const { program, at } = this.programFor({
      mode: MODES.findIndex((entry) => entry.id === look.mode),
      tone: shade ? (shade.map ? 4 : 3) + (shade.isLog ? 2 : 0) : TONE_MAPS.findIndex((entry) => entry.id === look.tone),
      taps: Math.min(Math.max(Math.ceil(footprint - 0.01), 1), MOST_TAPS),
    });
    gl.useProgram(program);
    for (const [name, unit] of Object.entries(UNITS)) gl.uniform1i(at[name as keyof typeof UNITS], unit);
    gl.uniform1f(at.viewportHeight, canvasHeight);
    gl.uniform1f(at.density, density);
    gl.uniform1i(at.onlyAbove, look.onlyAbove ? 1 : 0);
    if (shade) {
      gl.uniform2f(at.range, shade.range[0], shade.range[1]);
      if (shade.map) this.bind(UNITS.shades, this.mapOf(shade.map));
    }
    gl.uniform2f(at.samples, look.samples[0], look.samples[1]);
    this.bind(UNITS.frame, frame.picture);
    this.bind(UNITS.counts, frame.counts ?? this.nothing);
    this.bind(UNITS.other, other.picture);
    gl.uniform2f(at.corner, corner.left, corner.top);
    gl.uniform1f(at.zoom, pane.view.zoom);
    gl.uniform1f(at.reduction, reduce);
    gl.uniform1f(at.gain, 2 ** look.exposure / scale);
    gl.uniform1f(at.unscale, 1 / scale);
    gl.uniform1f(at.floorSquared, look.mode === 'truth' ? (0.1 * other.meanLuminance) ** 2 : (0.1 * frame.meanLuminance * scale) ** 2);
    gl.uniform1f(at.target, pane.target);
    gl.uniform1i(at.hasCounts, frame.counts ? 1 : 0);
    gl.uniform1f(at.replicateSize, replicate_size);
    gl.uniform1f(at.otherReduction, other.header.reduce);
    gl.uniform1f(at.otherUnscale, 1 / other.header.scale);
    // Screen pixels whose middle lies in the picture.
    const { clip, view, image } = pane;
    const left = Math.max(Math.round(clip.left), corner.left);
    const top = Math.max(Math.round(clip.top), corner.top);
    const right = Math.min(Math.round(clip.left + clip.width), corner.left + Math.ceil(image.width * view.zoom - 0.5));
    const bottom = Math.min(Math.round(clip.top + clip.height), corner.top + Math.ceil(image.height * view.zoom - 0.5));
    if (right <= left || bottom <= top) return;
    gl.scissor(left, canvasHeight - bottom, right - left, bottom - top);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /**
   * The canvas, large enough for `port`. It never shrinks, and pictures lie in its top left corner: a new size waits for
   * the whole screen to be put together, which software graphics take half a second for.
   */
  private grown(port: Size): Size {
    const { canvas } = this;
    if (canvas.width < port.width) canvas.width = port.width;
    if (canvas.height < port.height) canvas.height = port.height;
    return canvas;
  }

  private programFor(variant: Variant): Program {
    const key = Object.values(variant).join();
    let made = this.programs.get(key);
    if (!made) {
      const program = linked(this.gl, fragmentFor(variant));
      const places = UNIFORMS.map((name) => [name, this.gl.getUniformLocation(program, name)]);
      made = { program, at: Object.fromEntries(places) as Program['at'] };
      this.programs.set(key, made);
    }
    return made;
  }

  private mapOf(map: ColourMap): WebGLTexture {
    let made = this.maps.get(map);
    if (!made) {
      const { gl } = this;
      made = texture(gl, UNITS.shades, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, texelsOf(map));
      this.maps.set(map, made);
    }
    return made;
  }

  /** What was just painted, cut to the pictures: call it before the next turn of the worker's loop, when the canvas is cleared. */
  async shot({ port, panes }: Painting): Promise<Blob> {
    const { gl } = this;
    const edges = panes.map(({ clip, view, image }) => ({
      left: Math.max(clip.left, view.left, 0),
      top: Math.max(clip.top, view.top, 0),
      right: Math.min(clip.left + clip.width, view.left + image.width * view.zoom, port.width),
      bottom: Math.min(clip.top + clip.height, view.top + image.height * view.zoom, port.height),
    }));
    const left = Math.round(Math.min(...edges.map((edge) => edge.left)));
    const top = Math.round(Math.min(...edges.map((edge) => edge.top)));
    const width = Math.round(Math.max(...edges.map((edge) => edge.right))) - left;
    const height = Math.round(Math.max(...edges.map((edge) => edge.bottom))) - top;
    if (!(width > 0 && height > 0)) throw new Error('no part of the picture is in sight');
    const pixels = new Uint8Array(4 * width * height);
    gl.readPixels(left, this.canvas.height - top - height, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const upright = new ImageData(width, height);
    for (let row = 0; row < height; row++) upright.data.set(pixels.subarray(4 * width * (height - 1 - row), 4 * width * (height - row)), 4 * width * row);
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext('2d')!.putImageData(upright, 0, 0);
    return canvas.convertToBlob({ type: 'image/png' });
  }

  private bind(unit: number, held: WebGLTexture): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, held);
  }

  /** Draws one pixel of one pixel: drivers finish compiling at the first draw, which is then not a user's first picture. */
  private warmUp(): void {
    const one = { seq: 0, width: 1, height: 1, scale: 1, reduce: 1, replicate_size: 1 } as FrameHeader;
    const summary = { meanLuminance: 1, whiteLuminance: 1, histogram: new Uint32Array(), unknown: 0, invalid: 0 };
    this.keep(-1, { header: one, halves: new Uint16Array(4), counts: null, summary });
    const size = { width: 1, height: 1 };
    const view = { zoom: 1, left: 0, top: 0 };
    const pane = { clip: { left: 0, top: 0, ...size }, view, image: size, frame: -1, other: null, target: 1, reduce: 1 };
    const look = { mode: 'image', tone: 'srgb', exposure: 0, onlyAbove: false, shade: null, samples: [1, 2], well: [0, 0, 0] } as const;
    this.paint({ port: size, density: 1, panes: [pane], look });
    this.drop(-1);
  }
}

function texture(gl: WebGL2RenderingContext, unit: number, filter: number): WebGLTexture {
  const made = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return made;
}

function linked(gl: WebGL2RenderingContext, fragment: string): WebGLProgram {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]] as const) {
    const shader = gl.createShader(kind)!;
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? 'shader');
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? 'program');
  return program;
}
