/** The convergence chart on uPlot: made for one size and one theme, fed with data. */
import uPlot from 'uplot';
import { percent, tickDuration } from '../numbers/format';
import { type ChartData, logTicks, timeTicks } from './curves';

export interface Plot {
  show(data: ChartData): void;
  resize(width: number, height: number): void;
  dispose(): void;
}

export function makePlot(element: HTMLElement, first: ChartData): Plot {
  const style = getComputedStyle(element);
  const token = (name: string): string => style.getPropertyValue(name).trim();
  const text = token('--secondary');
  const font = `11px ${token('--sans')}`;
  const grid = { stroke: token('--grid'), width: 1 };
  const ticks = { ...grid, size: 4 };
  let held = first;

  const drawExpected = (plot: uPlot): void => {
    const { expected, target } = held;
    const level = target[0];
    if (!expected || level === null) return;
    const { ctx } = plot;
    const density = devicePixelRatio;
    const y = plot.valToPos(level, 'y', true);
    const [low, at, high] = [expected.low, expected.at, expected.high].map((seconds) =>
      plot.valToPos(Math.min(seconds, held.xRange[1]), 'x', true),
    );
    ctx.save();
    ctx.strokeStyle = token('--accent');
    ctx.fillStyle = token('--panel');
    ctx.lineWidth = 2 * density;
    ctx.beginPath();
    ctx.moveTo(low, y);
    ctx.lineTo(high, y);
    for (const end of [low, high]) {
      ctx.moveTo(end, y - 5 * density);
      ctx.lineTo(end, y + 5 * density);
    }
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(at, y, 4 * density, 0, 2 * Math.PI);
    ctx.fill();
    ctx.stroke();
    ctx.restore();
  };

  const plot = new uPlot(
    {
      width: Math.max(element.clientWidth, 100),
      height: Math.max(element.clientHeight, 80),
      padding: [8, 16, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, distr: 3, range: () => held.xRange },
        y: { distr: 3, range: () => held.yRange },
      },
      axes: [
        {
          stroke: text, font, grid, ticks, size: 28,
          splits: (u) => timeTicks(held.xRange[0], held.xRange[1], u.width / 70),
          filter: (_, splits) => splits,
          values: (_, splits) => splits.map((seconds) => tickDuration(seconds)),
        },
        {
          stroke: text, font, grid, ticks, size: 56,
          splits: (u) => logTicks(held.yRange[0], held.yRange[1], u.height / 26),
          filter: (_, splits) => splits,
          values: (_, splits) => splits.map((error) => percent(error, 1)),
        },
      ],
      series: [
        {},
        { stroke: token('--secondary'), width: 1.5, dash: [2, 4], spanGaps: true, points: { show: false } },
        { stroke: token('--warn'), width: 1.5, dash: [8, 5], spanGaps: true, points: { show: false } },
        { stroke: token('--second'), width: 2, dash: [6, 4], spanGaps: true, points: { show: false } },
        { stroke: token('--accent'), width: 1, spanGaps: true, points: { show: false } },
        { stroke: token('--accent'), width: 2, spanGaps: true, points: { show: (u) => u.data[0].length < 60, size: 5, fill: token('--accent') } },
      ],
      bands: [{ series: [4, 5], fill: `${token('--accent')}26` }],
      hooks: { draw: [drawExpected] },
    },
    columns(first),
    element,
  ); // prettier-ignore

  return {
    show(data) {
      held = data;
      plot.setData(columns(data));
    },
    resize(width, height) {
      plot.setSize({ width: Math.max(width, 100), height: Math.max(height, 80) });
    },
    dispose: () => plot.destroy(),
  };
}

const columns = (data: ChartData): uPlot.AlignedData => [data.x, data.root, data.target, data.other, data.bound, data.error];
