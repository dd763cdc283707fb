/**
 * The picture is drawn by one full-viewport triangle. Half floats arrive as 16-bit integers: NaN and infinity are
 * told apart by their bits, because drivers may assume in float arithmetic that neither occurs.
 */
export const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;

uniform usampler2D frame;      // R, G, B, SE of luminance as half patterns
uniform sampler2D inferno;
uniform vec2 viewport;         // device pixels
uniform vec2 corner;           // image's top left corner in the viewport
uniform vec2 extent;           // image size, image pixels
uniform float zoom;            // device pixels per image pixel
uniform float reduction;       // image pixels per texel side
uniform float gain;            // 2^exposure / frame scale
uniform float floorSquared;    // (0.1 mean luminance * scale)^2
uniform float target;
uniform int tone;              // 0 sRGB clip, 1 filmic, 2 Reinhard
uniform int mode;              // 0 image, 1 error
uniform bool onlyAbove;
uniform float density;         // device pixels per CSS pixel
uniform vec3 well;             // sRGB
out vec4 result;

const vec3 LUMA = vec3(0.2126, 0.7152, 0.0722);

struct Texel { vec3 radiance; float error; bool valid; bool known; };

bool isFinite(uint bits) { return (bits & 0x7c00u) != 0x7c00u; }

Texel fetch(ivec2 at) {
  uvec4 bits = texelFetch(frame, clamp(at, ivec2(0), textureSize(frame, 0) - 1), 0);
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

vec3 toned(vec3 radiance) {
  vec3 c = max(radiance, 0.0);
  if (tone == 1) c = (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
  else if (tone == 2) { float y = dot(c, LUMA); c /= 1.0 + y; }
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

void main() {
  vec2 screen = vec2(gl_FragCoord.x, viewport.y - gl_FragCoord.y);
  vec2 at = (screen - corner) / zoom;
  if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, extent))) { result = vec4(well, 1.0); return; }

  // Zoomed out, each screen pixel is the mean of the texels under it (at most 4 x 4 of them).
  float footprint = 1.0 / (zoom * reduction);
  int taps = clamp(int(ceil(footprint - 0.01)), 1, 4);
  vec3 radiance = vec3(0.0);
  vec3 colour = vec3(0.0);
  float known = 0.0;
  float invalid = 0.0;
  for (int j = 0; j < taps; j++) {
    for (int i = 0; i < taps; i++) {
      vec2 offset = (vec2(i, j) + 0.5) / float(taps) - 0.5;
      Texel texel = fetch(ivec2(floor(at / reduction + (taps > 1 ? offset * footprint : vec2(0.0)))));
      if (!texel.valid) { invalid += 1.0; continue; }
      radiance += texel.radiance;
      if (texel.known) { known += 1.0; if (mode == 1) colour += errorColour(texel); }
    }
  }
  float total = float(taps * taps);
  if (invalid > 0.0) {
    result = vec4(mix(vec3(1.0, 0.0, 0.85), vec3(0.0), stripes(screen, 6.0)), 1.0);
  } else if (mode == 0) {
    result = vec4(toned(radiance * gain / total), 1.0);
  } else {
    vec3 hatch = mix(vec3(0.18), vec3(0.32), stripes(screen, 8.0));
    result = vec4(known > 0.0 ? mix(hatch, colour / known, known / total) : hatch, 1.0);
  }
}`;
