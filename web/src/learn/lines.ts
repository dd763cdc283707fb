/** Curves of several techniques over the number of samples, on uPlot. */
import uPlot from 'uplot';
import type { Technique } from '../api/types';
import { logTicks } from '../chart/curves';
import { count } from '../numbers/format';
import { LOOKS } from './looks';

export interface Lines {
  /** Numbers of samples, ascending. */
  x: number[];
  curves: { technique: Technique; y: (number | null)[] }[];
  /** An interval around one technique: lower and upper ends. */
  band: { technique: Technique; low: (number | null)[]; high: (number | null)[] } | null;
  /** A dotted line to compare with. */
  guide: (number | null)[] | null;
  yRange: [number, number];
  isLog: boolean;
  shows: (value: number) => string;
}

/** Draws into `element`; returns what takes it away again. */
export function drawLines(element: HTMLElement, lines: Lines): () => void {
  const style = getComputedStyle(element);
  const token = (name: string): string => style.getPropertyValue(name).trim();
  const font = `11px ${token('--sans')}`;
  const grid = { stroke: token('--grid'), width: 1 };
  const axis = { stroke: token('--secondary'), font, grid, ticks: { ...grid, size: 4 } };
  const series: uPlot.Series[] = [{}];
  const data: (number | null)[][] = [lines.x];
  const bands: uPlot.Band[] = [];
  if (lines.band) {
    const colour = token(LOOKS[lines.band.technique].token);
    bands.push({ series: [series.length + 1, series.length], fill: `${colour}38` });
    for (const end of [lines.band.low, lines.band.high]) {
      series.push({ stroke: colour, width: 1, points: { show: false }, spanGaps: true });
      data.push(end);
    }
  }
  if (lines.guide) {
    series.push({ stroke: token('--secondary'), width: 1.5, dash: [2, 4], points: { show: false }, spanGaps: true });
    data.push(lines.guide);
  }
  for (const { technique, y } of lines.curves) {
    const { token: name, dash } = LOOKS[technique];
    series.push({ stroke: token(name), width: 2, dash, points: { show: false }, spanGaps: true });
    data.push(y);
  }
  const [low, high] = lines.yRange;
  const plot = new uPlot(
    {
      width: Math.max(element.clientWidth, 100),
      height: Math.max(element.clientHeight, 80),
      padding: [8, 12, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, distr: 3, range: () => [lines.x[0], lines.x[lines.x.length - 1]] },
        y: { distr: lines.isLog ? 3 : 1, range: () => [low, high] },
      },
      axes: [
        {
          ...axis, size: 26,
          splits: (u) => logTicks(lines.x[0], lines.x[lines.x.length - 1], u.width / 56),
          filter: (_, splits) => splits,
          values: (_, splits) => splits.map((n) => count(n)),
        },
        {
          ...axis, size: 62,
          ...(lines.isLog && { splits: (u: uPlot) => logTicks(low, high, u.height / 26), filter: (_: uPlot, splits: number[]) => splits }),
          values: (_, splits) => splits.map((value) => lines.shows(value)),
        },
      ],
      series,
      bands,
    },
    data as uPlot.AlignedData,
    element,
  ); // prettier-ignore
  const observer = new ResizeObserver(() => plot.setSize({ width: Math.max(element.clientWidth, 100), height: Math.max(element.clientHeight, 80) }));
  observer.observe(element);
  return () => {
    observer.disconnect();
    plot.destroy();
  };
}
