/** What is on the bench: one job's picture or two, how they are looked at, the probe and the region. */
import type { Job, Region } from '../api/types';
import type { Reading } from '../frame/reading';
import type { Action } from '../keys';
import { arrange, type Layout, otherView, type Port, portOf } from '../viewer/layout';
import { pictureCanvas } from '../viewer/canvas';
import { type Agreement, type HeldFrame, type Mode, MODES, needsTwo, type Pane, type Shade, TONE_MAPS } from '../viewer/scene';
import type { JobLook } from './address';
import { centred, clampZoom, fitView, panned, pixelAt, revealing, type Size, steppedZoom, type View, zoomAbout } from '../viewer/view';
import { layersAsked, type Layer } from '../files/raster';
import { files } from './files.svelte';
import type { ColourMap } from '../viewer/colourmaps';
import { COLOUR_MAPS } from '../viewer/colourmaps';
import { valuesOf } from '../frame/values';
import { Picture, type Probe } from './picture.svelte';
import { preferences } from './preferences.svelte';

export const EXPOSURE_LIMIT = 12;
const PAN_STEP = 64;

class Workbench {
  private readonly pictures = [new Picture(), new Picture()] as const;
  private isSwapped = $state(false);
  readonly a: Picture = $derived(this.pictures[this.isSwapped ? 1 : 0]);
  readonly b: Picture = $derived(this.pictures[this.isSwapped ? 0 : 1]);

  private cannotDraw = $state<string | null>(null);
  mode = $state<Mode>('image');
  exposure = $state(0);
  isOnlyAbove = $state(false);

  layout = $state<Layout>('wipe');
  /** Which of the two a flip shows. */
  flipped = $state<'a' | 'b'>('a');
  /** Where the wipe stands, 0…1 of the viewer's width. */
  wipeAt = $state(0.5);
  agreement = $state.raw<Agreement | null>(null);

  size = $state.raw<Size>({ width: 0, height: 0 });
  density = $state(1);
  isFitted = $state(true);
  private freeView = $state.raw<View>({ zoom: 1, left: 0, top: 0 });

  probe = $state.raw<Probe | null>(null);
  isPinned = $state(false);
  spoken = $state('');
  /** What came of something that was asked for, for a moment. */
  said = $state('');
  private saidTimer: ReturnType<typeof setTimeout> | undefined;

  say(text: string): void {
    this.said = text;
    clearTimeout(this.saidTimer);
    this.saidTimer = setTimeout(() => (this.said = ''), 4000);
  }

  /** Drawn with the mouse; a new render or a continued one can be told to count its error there. */
  region = $state.raw<Region | null>(null);
  isDrawingRegion = $state(false);

  /** Number of the newest frame that has been drawn. */
  paintedSeq = $state(0);
  /** From its bytes to the screen. */
  paintedMilliseconds = $state(0);

  private paintedId: number | null = null;

  readonly selectedId = $derived(this.a.id);
  readonly againstId = $derived(this.b.id);
  readonly isComparing = $derived(this.b.id !== null);
  readonly job: Job | null = $derived(this.a.job);
  readonly frame: HeldFrame | null = $derived(this.a.frame);
  readonly image: Size = $derived(this.a.image);
  /** Why this picture cannot be drawn here, where that is so; the service's PNG stands in. */
  readonly blindReason: string | null = $derived.by(() => {
    if (this.cannotDraw !== null) return this.cannotDraw;
    const limit = pictureCanvas.largestSide;
    const isTooLarge = this.frame !== null && Math.max(this.image.width, this.image.height) > limit;
    return isTooLarge ? `The picture is wider or higher than the ${limit} pixels that this graphics device takes` : null;
  });
  readonly target: number = $derived(this.a.target);
  readonly reading: Reading | null = $derived(this.a.readingAt(this.probe));
  readonly canSubtract: boolean = $derived(
    this.isComparing && this.a.image.width === this.b.image.width && this.a.image.height === this.b.image.height,
  );
  /** The mode that is drawn: without a second picture of the same size there is no difference. */
  readonly shownMode: Mode = $derived.by(() => {
    // Errors, samples and trust are the picture's own, not a layer's.
    if (this.layer !== '') return 'image';
    return needsTwo(this.mode) && !this.canSubtract ? 'image' : this.mode;
  });

  /** Of the file or job: "" is the picture itself. */
  get layer(): string {
    return this.a.layer;
  }
  set layer(name: string) {
    if (name === this.a.layer) return;
    for (const picture of this.pictures) picture.layer = name;
    this.typedRange = null;
  }

  /** Numbers through a colour map; null: as light, with exposure and tone map. */
  falseColour = $state<ColourMap | null>(null);
  isLog = $state(false);
  /** Ends typed by hand; null: those of the picture. */
  typedRange = $state.raw<readonly [number, number] | null>(null);
  /** What the picture's finite values reach: of layers that are no light all of them, else 1 % and 99 % of luminance. */
  private readonly reach = $derived(this.frame ? valuesOf(this.frame) : null);
  /** Layers of picture A beside the picture itself; of a job those that it was asked for. */
  readonly layers: readonly Layer[] = $derived(this.a.file?.info.layers.slice(1) ?? layersAsked(this.job?.settings.channels ?? []));
  readonly isLight: boolean = $derived(this.layer === '' || /(^|\.)(albedo|S0)$/.test(this.layer));
  private readonly isScalar: boolean = $derived(this.layers.find((one) => one.name === this.layer)?.channels.length === 1);
  readonly map: ColourMap | null = $derived(this.falseColour ?? (this.isScalar ? 'viridis' : null));
  readonly range: readonly [number, number] = $derived.by(() => {
    if (this.typedRange) return this.typedRange;
    if (!this.reach) return [0, 1];
    const [low, high] = this.isLight || this.isScalar ? this.reach.usual : this.reach.whole;
    const start = this.isLog ? Math.max(low, high * 1e-4, 1e-12) : low;
    return high > start ? [start, high] : [start, start + (Math.abs(start) || 1)];
  });
  readonly shade: Shade | null = $derived.by(() => {
    if (this.shownMode !== 'image' || (this.map === null && this.isLight)) return null;
    return { map: this.map, range: this.range, isLog: this.isLog && this.range[0] > 0 };
  });

  readonly port: Port = $derived(portOf(this.size, this.effectiveLayout, this.density));
  readonly view: View = $derived(this.isFitted ? fitView(this.image, this.port) : this.freeView);
  readonly panes: Pane[] = $derived(
    arrange({
      size: this.size,
      density: this.density,
      layout: this.effectiveLayout,
      view: this.view,
      wipeAt: this.wipeAt,
      flipped: this.flipped,
      isJoint: needsTwo(this.shownMode),
      a: { image: this.a.image, frame: this.a.frame?.id ?? null, target: this.a.target, reduce: this.a.frame?.header.reduce ?? 1 },
      b: { image: this.b.image, frame: this.b.frame?.id ?? null, target: this.b.target, reduce: this.b.frame?.header.reduce ?? 1 },
    }),
  );
  /** Ends of the samples map: what the frames have, at least a factor of four apart. */
  readonly samples: readonly [number, number] = $derived.by(() => {
    const headers = [this.a, this.b].map((picture) => picture.frame?.header).filter((header) => header !== undefined);
    const low = Math.max(Math.min(...headers.map((header) => header.spp_min)), 1);
    const high = Math.max(...headers.map((header) => header.spp_max), 1);
    if (headers.length === 0) return [1, 4];
    const middle = Math.sqrt(low * high);
    return high >= 4 * low ? [low, high] : [middle / 2, middle * 2];
  });

  private get effectiveLayout(): Layout | 'single' {
    if (!this.isComparing || needsTwo(this.shownMode)) return 'single';
    return this.layout;
  }

  /** Wires selection, frames and the pixel reading together; called once. Returns its undo. */
  start(): () => void {
    pictureCanvas.onBlind = (reason) => (this.cannotDraw = reason);
    // Ready before the first picture, but not before the page: the graphics context costs half a second of both.
    const begin = (): void => pictureCanvas.start();
    if ('requestIdleCallback' in window) requestIdleCallback(begin, { timeout: 1500 });
    else setTimeout(begin, 300);
    return $effect.root(() => {
      const wantsMaps = (): boolean => this.mode === 'samples' || this.mode === 'trust';
      for (const picture of this.pictures) picture.follow(() => this.probe, wantsMaps);
      $effect(() => this.compare());
      $effect(() => this.settle());
    });
  }

  /** Picture A has been drawn with this frame. */
  notePainted(frame: HeldFrame | null): void {
    if (frame && frame.id !== this.paintedId) this.paintedMilliseconds = performance.timeOrigin + performance.now() - this.a.bytesArrived;
    if (!frame) this.paintedMilliseconds = 0;
    this.paintedId = frame?.id ?? null;
    this.paintedSeq = frame?.header.seq ?? 0;
  }

  /** Opens files as pictures: one as the reference of a picture of its size that is on the bench, else by itself. */
  async openFiles(given: readonly File[]): Promise<void> {
    const file = await files.open(given);
    if (!file) return;
    const isSame = this.a.isOpen && file.info.width === this.image.width && file.info.height === this.image.height;
    if (!isSame) {
      location.hash = `#/jobs/${file.id}`;
      return;
    }
    this.against(file.id);
    this.layer = '';
    this.mode = 'truth';
  }

  /** The view as a link tells it, once it has come to rest. */
  private settled = $state.raw<Pick<JobLook, 'zoom' | 'at'>>({});
  /** From a link, until the viewer has a size and the picture too. */
  private wantedView = $state.raw<Pick<JobLook, 'zoom' | 'at'> | null>(null);

  /** How the picture is looked at, for a link. */
  readonly look: JobLook = $derived({
    // A tone map is this browser's own choice; a link carries it where it is none of the usual.
    ...(preferences.tone !== 'srgb' && { tone: preferences.tone }),
    ...(this.falseColour && { map: this.falseColour }),
    ...(this.typedRange && { range: this.typedRange }),
    ...(this.isLog && { isLog: true as const }),
    ...(this.layer !== '' && { layer: this.layer }),
    ...(this.wantedView ?? (this.isFitted ? {} : this.settled)),
    ...(this.isPinned && this.probe && { pixel: this.probe }),
    ...(this.region && { region: this.region }),
  });

  /** What stays from picture to picture. */
  readonly kept: JobLook = $derived.by(() => {
    const { tone, map, range, isLog } = this.look;
    return { ...(tone && { tone }), ...(map && { map }), ...(range && this.layer === '' && { range }), ...(isLog && { isLog }) };
  });

  /** Looks at the picture as a link says. */
  lookAs({ tone, map, range, isLog, layer, zoom, at, pixel, region }: JobLook): void {
    if (tone) preferences.tone = tone;
    this.falseColour = map ?? null;
    this.layer = layer ?? '';
    this.typedRange = range ?? null;
    this.isLog = isLog ?? false;
    if (region) this.region = region;
    if (pixel) [this.probe, this.isPinned] = [pixel, true];
    if (zoom !== undefined && at) this.wantedView = { zoom, at };
  }

  /** Takes a link's view once there is room for it, and notes where the view has come to rest. */
  private settle(): (() => void) | undefined {
    const { wantedView, density, port } = this;
    if (wantedView?.zoom !== undefined && wantedView.at) {
      if (port.width === 0 || this.a.main === null) return undefined;
      const zoom = clampZoom(wantedView.zoom * density);
      this.freeView = { zoom, left: port.width / 2 - wantedView.at.x * zoom, top: port.height / 2 - wantedView.at.y * zoom };
      this.isFitted = false;
      this.settled = wantedView;
      // The viewer takes its last size once everything around it is there.
      const timer = setTimeout(() => (this.wantedView = null), 600);
      return () => clearTimeout(timer);
    }
    const { freeView } = this;
    const timer = setTimeout(() => {
      const { zoom, left, top } = freeView;
      this.settled = { zoom: zoom / density, at: { x: (port.width / 2 - left) / zoom, y: (port.height / 2 - top) / zoom } };
    }, 250);
    return () => clearTimeout(timer);
  }

  /** Puts a job on the bench, and another beside it. */
  select(id: string | null, against: string | null = null): void {
    if (against === id) against = null;
    if (id !== null && id === this.b.id && id !== this.a.id) this.isSwapped = !this.isSwapped;
    if (id !== this.a.id) {
      this.a.id = id;
      this.probe = null;
      this.isPinned = false;
      this.isFitted = true;
      this.region = null;
      this.layer = '';
      this.wantedView = null;
    }
    this.against(against);
  }

  against(id: string | null): void {
    if (id === this.b.id) return;
    this.b.id = id;
    this.flipped = 'a';
    if (id === null && needsTwo(this.mode)) this.mode = 'image';
  }

  swap(): void {
    if (this.isComparing) this.isSwapped = !this.isSwapped;
  }

  private compare(): (() => void) | undefined {
    const [a, b] = [this.a.frame, this.b.frame];
    if (!a || !b || this.shownMode !== 'difference') {
      this.agreement = null;
      return undefined;
    }
    let isCurrent = true;
    pictureCanvas.agree(a, b).then(
      (agreement) => isCurrent && (this.agreement = agreement),
      () => undefined,
    );
    return () => (isCurrent = false);
  }

  /** Image pixel of picture A under a point of the viewer, in device pixels; null beside the picture. */
  pixelUnder(x: number, y: number): Probe | null {
    return pixelAt(this.view, this.image, this.inPane(x), y);
  }

  /** In the right half of two pictures side by side, as if it were the left. */
  inPane(x: number): number {
    return this.effectiveLayout === 'side' && x >= this.port.width + this.port.gap ? x - this.port.width - this.port.gap : x;
  }

  moveProbe(x: number, y: number): void {
    const next = {
      x: Math.min(Math.max(x, 0), this.image.width - 1),
      y: Math.min(Math.max(y, 0), this.image.height - 1),
    };
    if (next.x !== this.probe?.x || next.y !== this.probe.y) this.probe = next;
  }

  /** The same pixel in picture B, whose size may differ. */
  viewOfB(view: View): View {
    return otherView(view, this.a.image, this.b.image);
  }

  setView(view: View): void {
    this.wantedView = null;
    this.freeView = view;
    this.isFitted = false;
  }

  zoomTo(zoom: number, x = this.port.width / 2, y = this.port.height / 2): void {
    this.setView(zoomAbout(this.view, zoom, x, y));
  }

  pan(dx: number, dy: number): void {
    this.setView(panned(this.view, dx, dy, this.image, this.port));
  }

  setExposure(stops: number): void {
    this.exposure = Math.min(Math.max(Math.round(stops * 10) / 10, -EXPOSURE_LIMIT), EXPOSURE_LIMIT);
  }

  private toggle(mode: Mode): true {
    this.mode = this.mode === mode ? 'image' : mode;
    return true;
  }

  private lay(layout: Layout, shown?: 'a' | 'b'): boolean {
    if (!this.isComparing) return false;
    if (needsTwo(this.mode)) this.mode = 'image';
    this.layout = layout;
    if (shown) this.flipped = shown;
    return true;
  }

  /** Carries out a view or probe action; false where the action is none of the bench's. */
  act(action: Action): boolean {
    switch (action) {
      case 'exposureUp': this.setExposure(this.exposure + 0.5); return true;
      case 'exposureDown': this.setExposure(this.exposure - 0.5); return true;
      case 'exposureReset': this.setExposure(0); return true;
      case 'normalise':
        if (this.frame) this.setExposure(-Math.log2(this.frame.summary.whiteLuminance));
        return true;
      case 'nextToneMap': {
        const at = TONE_MAPS.findIndex((entry) => entry.id === preferences.tone);
        preferences.tone = TONE_MAPS[(at + 1) % TONE_MAPS.length].id;
        return true;
      }
      case 'toggleError': return this.toggle('error');
      case 'toggleDifference': return this.canSubtract && this.toggle('difference');
      case 'nextView': {
        const modes = MODES.filter((entry) => !needsTwo(entry.id) || this.canSubtract);
        this.mode = modes[(modes.findIndex((entry) => entry.id === this.mode) + 1) % modes.length].id;
        return true;
      }
      case 'toggleTruth': return this.canSubtract && this.toggle('truth');
      case 'nextColours': {
        const choices = [null, ...COLOUR_MAPS.map((entry) => entry.id)];
        this.falseColour = choices[(choices.indexOf(this.falseColour) + 1) % choices.length];
        this.mode = 'image';
        return true;
      }
      case 'onlyAbove': this.isOnlyAbove = !this.isOnlyAbove; this.mode = 'error'; return true;
      case 'showA': return this.lay('flip', 'a');
      case 'showB': return this.lay('flip', 'b');
      case 'swap': this.swap(); return this.isComparing;
      case 'wipe': return this.lay('wipe');
      case 'sideBySide': return this.lay('side');
      case 'drawRegion': this.isDrawingRegion = !this.isDrawingRegion; return true;
      case 'fit': this.isFitted = true; this.wantedView = null; return true;
      case 'actualSize': this.setView(centred(this.image, this.port, 1)); return true;
      case 'zoomIn': this.zoomTo(steppedZoom(this.view.zoom, 1)); return true;
      case 'zoomOut': this.zoomTo(steppedZoom(this.view.zoom, -1)); return true;
      case 'panLeft': this.pan(PAN_STEP, 0); return true;
      case 'panRight': this.pan(-PAN_STEP, 0); return true;
      case 'panUp': this.pan(0, PAN_STEP); return true;
      case 'panDown': this.pan(0, -PAN_STEP); return true;
      case 'probeLeft': this.stepProbe(-1, 0); return true;
      case 'probeRight': this.stepProbe(1, 0); return true;
      case 'probeUp': this.stepProbe(0, -1); return true;
      case 'probeDown': this.stepProbe(0, 1); return true;
      case 'pin': if (!this.probe) this.stepProbe(0, 0); this.isPinned = true; return true;
      case 'unpin':
        if (this.isDrawingRegion) this.isDrawingRegion = false;
        else this.isPinned = false;
        return true;
      default: return false;
    }
  } // prettier-ignore

  private stepProbe(dx: number, dy: number): void {
    const from = this.probe ?? { x: Math.floor(this.image.width / 2), y: Math.floor(this.image.height / 2) };
    this.isPinned = true;
    this.moveProbe(from.x + dx, from.y + dy);
    if (this.probe && !this.isFitted) {
      const view = revealing(this.view, this.image, this.port, this.probe.x, this.probe.y);
      if (view !== this.view) this.setView(view);
    }
    this.spoken = this.describeProbe();
  }

  private describeProbe(): string {
    const { probe, reading } = this;
    if (!probe) return '';
    const where = `Pixel ${probe.x}, ${probe.y}: `;
    if (!reading) return `${where}no samples yet.`;
    if (!reading.isValid) return `${where}not a number.`;
    const value = `luminance ${reading.luminance.toPrecision(3)}`;
    if (!reading.hasEstimate) return `${where}${value}, no error estimate yet.`;
    return `${where}${value}, ${reading.isRough ? 'about ' : ''}plus or minus ${reading.half.toPrecision(2)}.`;
  }
}

export const workbench = new Workbench();
