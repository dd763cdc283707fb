/**
 * The picture is drawn by one triangle that is cut to where the picture lies, with a program made for the mode, the tone and the number of texels
 * under a screen pixel: software graphics run through every branch that a program has. Half floats arrive as 16-bit integers: NaN and infinity are
 * told apart by their bits, because drivers may assume in float arithmetic that neither occurs.
 */
import { DIFFERENCE_RANGE } from './scene';

export const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

/** What a program is made for. mode, tone: places in MODES and TONE_MAPS. taps: texels under a screen pixel, a side. */
export interface Variant {
  mode: number;
  tone: number;
  taps: number;
}

export const fragmentFor = ({ mode, tone, taps }: Variant): string => `#version 300 es
#define MODE ${mode}  // 0 image, 1 error, 2 samples, 3 trust, 4 difference, 5 true error
#define TONE ${tone}  // 0 sRGB clip, 1 filmic, 2 Reinhard; 3 to 6 shades: channels as grey, a map, either by logarithm
#define TAPS ${taps}
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D frame;      // R, G, B, SE of luminance as half patterns
uniform usampler2D counts;     // replicates as half patterns, negative where not trusted
uniform usampler2D other;      // as frame: what a difference subtracts
uniform sampler2D inferno;
uniform sampler2D shades;      // colour map of a shade
uniform vec2 range;            // of a shade
uniform float viewportHeight;  // device pixels
uniform vec2 corner;           // image's top left corner in the viewport
uniform float zoom;            // device pixels per image pixel
uniform float reduction;       // image pixels per texel side
uniform float gain;            // 2^exposure / frame scale
uniform float unscale;         // 1 / frame scale
uniform float otherReduction;
uniform float otherUnscale;
uniform float floorSquared;    // (0.1 mean luminance * scale)^2, of the truth where there is one
uniform float target;
uniform bool hasCounts;
uniform float replicateSize;   // samples per replicate
uniform vec2 samples;          // ends of the samples map, samples per pixel
uniform bool onlyAbove;
uniform float density;         // device pixels per CSS pixel
out vec4 result;

const vec3 LUMA = vec3(0.2126, 0.7152, 0.0722);

struct Texel { vec3 radiance; float error; bool valid; bool known; };

bool isFinite(uint bits) { return (bits & 0x7c00u) != 0x7c00u; }

Texel texelOf(uvec4 bits) {
  Texel texel;
  texel.valid = isFinite(bits.r) && isFinite(bits.g) && isFinite(bits.b);
  texel.radiance = texel.valid ? vec3(unpackHalf2x16(bits.r).x, unpackHalf2x16(bits.g).x, unpackHalf2x16(bits.b).x) : vec3(0.0);
  texel.known = texel.valid && isFinite(bits.a);
  texel.error = texel.known ? unpackHalf2x16(bits.a).x : 0.0;
  // Nothing found and no spread is "no estimate yet", not "perfect".
  if (texel.error == 0.0 && dot(texel.radiance, LUMA) == 0.0) texel.known = false;
  return texel;
}

vec3 encode(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), c));
}

// A shade is of the numbers themselves: no exposure, no gamma.
vec3 shaded(vec3 values) {
#if TONE == 3 || TONE == 5
  vec3 v = values;
#else
  vec3 v = vec3(dot(values, LUMA));
#endif
#if TONE >= 5
  vec3 t = log(max(v, 1e-30) / range.x) / log(range.y / range.x);
#else
  vec3 t = (v - range.x) / (range.y - range.x);
#endif
  t = clamp(t, 0.0, 1.0);
#if TONE == 3 || TONE == 5
  return t;
#else
  return texture(shades, vec2(t.x * (255.0 / 256.0) + 0.5 / 256.0, 0.5)).rgb;
#endif
}

vec3 toned(vec3 radiance) {
  vec3 c = max(radiance, 0.0);
#if TONE == 1
  c = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
#elif TONE == 2
  c /= 1.0 + dot(c, LUMA);
#endif
  return encode(c);
}

float stripes(vec2 at, float period) { return step(0.5, fract((at.x + at.y) / (period * density))); }

vec3 errorColour(Texel texel) {
  float y = dot(texel.radiance, LUMA);
  float relative = texel.error / sqrt(y * y + floorSquared);
  float at = 0.5 + 0.5 * log(max(relative, 1e-12) / target) / log(10.0);
  if (onlyAbove && relative <= target) return vec3(0.12 + 0.5 * encode(vec3(y * gain)).g * 0.5);
  return texture(inferno, vec2(clamp(at, 0.0, 1.0) * (255.0 / 256.0) + 0.5 / 256.0, 0.5)).rgb;
}

// Few dark blue, many white.
vec3 samplesColour(float replicates) {
  float spread = max(log(samples.y / samples.x), 1e-3);
  float t = clamp(log(max(replicates * replicateSize, 1e-3) / samples.x) / spread, 0.0, 1.0);
  vec3 low = vec3(0.055, 0.09, 0.16), middle = vec3(0.19, 0.47, 0.78), high = vec3(0.94, 0.97, 1.0);
  return t < 0.5 ? mix(low, middle, 2.0 * t) : mix(middle, high, 2.0 * t - 1.0);
}

// z = (A - B) / their standard errors together: blue where A is darker, orange where it is brighter, dark grey between.
vec3 differenceColour(Texel a, Texel b) {
  float gap = dot(a.radiance, LUMA) * unscale - dot(b.radiance, LUMA) * otherUnscale;
  float spread = length(vec2(a.error * unscale, b.error * otherUnscale));
  float z = spread > 0.0 ? gap / spread : (gap == 0.0 ? 0.0 : sign(gap) * 1e3);
  float t = clamp(abs(z) / ${DIFFERENCE_RANGE}.0, 0.0, 1.0);
  return mix(vec3(0.16), z < 0.0 ? vec3(0.30, 0.62, 1.0) : vec3(1.0, 0.60, 0.16), t);
}

// |A - B| / B, on the colours of the estimated error: B is the truth.
vec3 truthColour(Texel a, Texel b) {
  float gap = abs(dot(a.radiance, LUMA) * unscale - dot(b.radiance, LUMA) * otherUnscale);
  float y = dot(b.radiance, LUMA) * otherUnscale;
  float at = 0.5 + 0.5 * log(max(gap / sqrt(y * y + floorSquared), 1e-12) / target) / log(10.0);
  return texture(inferno, vec2(clamp(at, 0.0, 1.0) * (255.0 / 256.0) + 0.5 / 256.0, 0.5)).rgb;
}

ivec2 inside(vec2 at, ivec2 size) { return clamp(ivec2(floor(at)), ivec2(0), size - 1); }

void main() {
  vec2 screen = vec2(gl_FragCoord.x, viewportHeight - gl_FragCoord.y);
  vec2 at = (screen - corner) / zoom;

  // Zoomed out, each screen pixel is the mean of the texels under it (at most TAPS x TAPS of them).
  float footprint = 1.0 / (zoom * reduction);
  ivec2 size = textureSize(frame, 0);
  vec3 radiance = vec3(0.0);
  vec3 colour = vec3(0.0);
  float known = 0.0;
  float invalid = 0.0;
  float untrusted = 0.0;
  for (int j = 0; j < TAPS; j++) {
    for (int i = 0; i < TAPS; i++) {
#if TAPS > 1
      vec2 offset = ((vec2(i, j) + 0.5) / float(TAPS) - 0.5) * footprint;
#else
      vec2 offset = vec2(0.0);
#endif
      ivec2 here = inside(at / reduction + offset, size);
      Texel texel = texelOf(texelFetch(frame, here, 0));
      if (!texel.valid) { invalid += 1.0; continue; }
      radiance += texel.radiance;
#if MODE == 1
      if (texel.known) { known += 1.0; colour += errorColour(texel); }
#elif MODE == 2 || MODE == 3
      uint bits = hasCounts ? texelFetch(counts, here, 0).r : 0u;
      float replicates = unpackHalf2x16(bits & 0x7fffu).x;
      if (replicates > 0.0) {
        known += 1.0;
#if MODE == 2
        colour += samplesColour(replicates);
#endif
      }
      if ((bits & 0x8000u) != 0u) untrusted += 1.0;
#elif MODE == 4
      vec2 there = (at + offset * reduction) / otherReduction;
      Texel against = texelOf(texelFetch(other, inside(there, textureSize(other, 0)), 0));
      if (texel.known && against.known) { known += 1.0; colour += differenceColour(texel, against); }
#elif MODE == 5
      vec2 there = (at + offset * reduction) / otherReduction;
      Texel truth = texelOf(texelFetch(other, inside(there, textureSize(other, 0)), 0));
      if (truth.valid) { known += 1.0; colour += truthColour(texel, truth); }
#endif
    }
  }
  const float total = float(TAPS * TAPS);
  vec3 shown;
#if MODE == 0
#if TONE >= 3
  shown = shaded(radiance * unscale / total);
#else
  shown = toned(radiance * gain / total);
#endif
#else
  vec3 hatch = mix(vec3(0.18), vec3(0.32), stripes(screen, 8.0));
#if MODE == 3
  vec3 grey = vec3(dot(toned(radiance * gain / total), LUMA)) * 0.75 + 0.05;
  // The picture stays to be seen under the stripes: one wants to know what is doubtful.
  vec3 doubt = mix(mix(grey, vec3(0.89, 0.70, 0.25), 0.62), grey * 0.55, stripes(screen, 6.0));
  shown = known > 0.0 ? mix(grey, doubt, untrusted / total) : hatch;
#else
  shown = known > 0.0 ? mix(hatch, colour / known, known / total) : hatch;
#endif
#endif
  if (invalid > 0.0) shown = mix(vec3(1.0, 0.0, 0.85), vec3(0.0), stripes(screen, 6.0));
  result = vec4(shown, 1.0);
}`;
