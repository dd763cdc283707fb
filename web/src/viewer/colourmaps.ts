/**
 * Colour maps for numbers: each step of them looks alike, in grey and to who tells few colours too. 33 colours each, within 6/255 of the
 * published tables, mixed between: viridis and cividis (matplotlib, CC0), batlow (Crameri, "Scientific colour maps", MIT).
 */
import { infernoTexels } from './inferno';

export type ColourMap = 'viridis' | 'cividis' | 'batlow' | 'inferno';

export const COLOUR_MAPS: readonly { id: ColourMap; label: string }[] = [
  { id: 'viridis', label: 'Viridis' },
  { id: 'cividis', label: 'Cividis' },
  { id: 'batlow', label: 'Batlow' },
  { id: 'inferno', label: 'Inferno' },
];

const KNOTS: Record<Exclude<ColourMap, 'inferno'>, string> = {
  viridis:
    '440154470d6048186a482374472d7b4536814240863f49893b528b375a8d33638d2f6a8e2c728e297a8e26818e23898e21908c1f988b1f9f8821a68528ae8031b57b3ebc744cc26c5dc9636ece5882d34c96d83fabdc32c0df24d5e21aeae51afde725',
  cividis:
    '00224e00285b002e6a0433711a386f273e6e32436d3b496c434e6c4b546c52596d5a5f6e61656f686a716f70737576767c7b788481798b8778938d789b9376a39a75aba072b3a670bbad6cc3b469ccba64d4c15fddc958e6d051efd748f8df3cfee838',
  batlow:
    '01195908255b0d315d0f3b5f114360134b611652621b59622260612a655e356a59406f544d734d597646667a3f737e3881823290862da08a2bb08d2ebf9035ce923fdb954ce8985bf29d6cf8a27efca891fdaea3fdb4b4fdbac5fcc0d6fbc6e8faccfa',
};

/** 256 RGBA texels. */
export function texelsOf(map: ColourMap): Uint8Array {
  if (map === 'inferno') return infernoTexels();
  const knots = KNOTS[map];
  const last = knots.length / 6 - 1;
  const channel = (knot: number, c: number): number => Number.parseInt(knots.slice(6 * knot + 2 * c, 6 * knot + 2 * c + 2), 16);
  const texels = new Uint8Array(4 * 256);
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * last;
    const knot = Math.min(Math.floor(at), last - 1);
    for (let c = 0; c < 3; c++) texels[4 * i + c] = Math.round(channel(knot, c) + (at - knot) * (channel(knot + 1, c) - channel(knot, c)));
    texels[4 * i + 3] = 255;
  }
  return texels;
}

/** For a legend. */
export function gradientOf(map: ColourMap): string {
  const texels = texelsOf(map);
  const stops = Array.from({ length: 17 }, (_, i) => `rgb(${texels.subarray(4 * Math.round((255 * i) / 16)).slice(0, 3).join(' ')})`);
  return `linear-gradient(to right, ${stops.join(', ')})`;
}
