/** Draws a frame with WebGL2. Holds textures, no view state: everything that decides a picture comes with the call. */
import type { Frame } from '../frame/decode';
import { infernoTexels } from './inferno';
import { FRAGMENT, VERTEX } from './shaders';
import type { View } from './view';

export type ToneMap = 'srgb' | 'filmic' | 'reinhard';
export type Mode = 'image' | 'error';

export interface Look {
  mode: Mode;
  tone: ToneMap;
  /** Stops. */
  exposure: number;
  /** Relative error in the middle of the error map. */
  target: number;
  onlyAbove: boolean;
  /** sRGB, 0…1 per channel. */
  well: readonly [number, number, number];
}

export const TONE_MAPS: readonly { id: ToneMap; label: string }[] = [
  { id: 'srgb', label: 'sRGB clip' },
  { id: 'filmic', label: 'Filmic' },
  { id: 'reinhard', label: 'Reinhard' },
];

const UNIFORMS = [
  'frame', 'inferno', 'viewport', 'corner', 'extent', 'zoom', 'reduction', 'gain', 'floorSquared', 'target', 'tone',
  'mode', 'onlyAbove', 'density', 'well',
] as const; // prettier-ignore

export class Painter {
  private readonly gl: WebGL2RenderingContext;
  private readonly program: WebGLProgram;
  private readonly at: Record<(typeof UNIFORMS)[number], WebGLUniformLocation | null>;
  private readonly picture: WebGLTexture;
  private held: Frame | null = null;

  /** Throws where WebGL2 is missing or the program does not link. */
  constructor(canvas: HTMLCanvasElement) {
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error('WebGL2 is not available here');
    this.gl = gl;
    this.program = linked(gl);
    this.at = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(this.program, name)])) as typeof this.at;
    this.picture = texture(gl, 0);
    texture(gl, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, infernoTexels());
  }

  private upload(frame: Frame): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const { width, height } = frame.header;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16UI, width, height, 0, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, frame.halves);
    this.held = frame;
  }

  paint(frame: Frame | null, image: { width: number; height: number }, view: View, look: Look, density: number): void {
    const { gl, at } = this;
    if (gl.isContextLost()) return;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    if (!frame) {
      this.held = null;
      gl.clearColor(look.well[0], look.well[1], look.well[2], 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      return;
    }
    if (frame !== this.held) this.upload(frame);
    const { scale, reduce } = frame.header;
    gl.useProgram(this.program);
    gl.uniform1i(at.frame, 0);
    gl.uniform1i(at.inferno, 1);
    gl.uniform2f(at.viewport, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.uniform2f(at.corner, Math.round(view.left), Math.round(view.top));
    gl.uniform2f(at.extent, image.width, image.height);
    gl.uniform1f(at.zoom, view.zoom);
    gl.uniform1f(at.reduction, reduce);
    gl.uniform1f(at.gain, 2 ** look.exposure / scale);
    gl.uniform1f(at.floorSquared, (0.1 * frame.summary.meanLuminance * scale) ** 2);
    gl.uniform1f(at.target, look.target);
    gl.uniform1i(at.tone, TONE_MAPS.findIndex((entry) => entry.id === look.tone));
    gl.uniform1i(at.mode, look.mode === 'error' ? 1 : 0);
    gl.uniform1i(at.onlyAbove, look.onlyAbove ? 1 : 0);
    gl.uniform1f(at.density, density);
    gl.uniform3f(at.well, look.well[0], look.well[1], look.well[2]);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Largest texture side; larger images are shown as a PNG instead. */
  get largestSide(): number {
    return this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
  }
}

function texture(gl: WebGL2RenderingContext, unit: number): WebGLTexture {
  const made = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, made);
  const filter = unit === 0 ? gl.NEAREST : gl.LINEAR;
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return made;
}

function linked(gl: WebGL2RenderingContext): WebGLProgram {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
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
