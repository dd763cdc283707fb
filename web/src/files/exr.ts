/**
 * OpenEXR files, by the published layout (openexr.com, "OpenEXR File Layout"): scan lines or tiles of one level, half, float and
 * whole numbers, any channels; uncompressed, RLE, ZIPS, ZIP, PIZ and PXR24. Of several parts the first. The browser inflates.
 */
import { halfTable } from '../frame/half';
import { unpackPiz } from './piz';
import { FileError, MOST_VALUES, type Raster } from './raster';

const MAGIC = 20000630;
const COMPRESSIONS = ['none', 'RLE', 'ZIPS', 'ZIP', 'PIZ', 'PXR24', 'B44', 'B44A', 'DWAA', 'DWAB'];
const LINES = [1, 1, 1, 16, 32, 16];
const TYPES = ['uint', 'half', 'float'] as const;

export type ChannelType = (typeof TYPES)[number];

/** One channel in a block: its type says how many bytes a value has. */
export interface Channel {
  name: string;
  type: ChannelType;
}

interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

interface Header {
  channels: Channel[];
  compression: number;
  data: Box;
  display: Box;
  tile: { width: number; height: number } | null;
  attributes: Record<string, string | number>;
}

export const bytesOf = (type: ChannelType): number => (type === 'half' ? 2 : 4);

export const isExr = (file: ArrayBuffer): boolean => file.byteLength > 8 && new DataView(file).getInt32(0, true) === MAGIC;

/** Raises FileError: what is wrong, and what to do. */
export async function readExr(file: ArrayBuffer): Promise<Raster> {
  try {
    return await readAll(new Reader(file));
  } catch (cause) {
    if (cause instanceof FileError) throw cause;
    throw new FileError('this EXR file is cut off or damaged: it ends, or does not unpack, before the picture does');
  }
}

async function readAll(reader: Reader): Promise<Raster> {
  const magic = reader.int();
  if (magic !== MAGIC) throw new FileError('this is no EXR file: it does not begin as one');
  const flags = reader.int();
  const isMultipart = (flags & 0x1000) !== 0;
  if (flags & 0x800) throw new FileError('deep EXR files are not read here: flatten it first');
  const headers = [readHeader(reader, (flags & 0x200) !== 0)];
  while (isMultipart && reader.peek() !== 0) headers.push(readHeader(reader, false));
  if (isMultipart) reader.byte();
  return readPart(reader, headers[0], isMultipart);
}

async function readPart(reader: Reader, header: Header, isMultipart: boolean): Promise<Raster> {
  const { data, display, channels, compression, tile } = header;
  if (display.width * display.height * channels.length > MOST_VALUES || data.width * data.height * channels.length > MOST_VALUES)
    throw new FileError(`${display.width} × ${display.height} pixels in ${channels.length} channels are more than the ${MOST_VALUES} values that fit here`);
  const planes = channels.map(() => new Float32Array(display.width * display.height));
  const lines = LINES[compression];
  const across = tile ? Math.ceil(data.width / tile.width) : 1;
  const blocks = tile ? across * Math.ceil(data.height / tile.height) : Math.ceil(data.height / lines);
  const offsets = Array.from({ length: blocks }, () => reader.long());
  for (const offset of offsets) {
    reader.at = offset + (isMultipart ? 4 : 0);
    const box = tile ? tileBox(reader, tile, data) : linesBox(reader, lines, data);
    const packed = reader.bytes(reader.int());
    const size = channels.reduce((sum, { type }) => sum + bytesOf(type), 0) * box.width * box.height;
    const bytes = await unpack(packed, size, header, box);
    if (bytes.length < size) throw new FileError('a block of this EXR file unpacks to less than it must: the file is damaged');
    scatter(bytes, box, header, planes);
  }
  return {
    width: display.width, height: display.height, attributes: header.attributes,
    planes: new Map(channels.map(({ name }, index) => [name, planes[index]])),
  }; // prettier-ignore
}

function linesBox(reader: Reader, lines: number, data: Box): Box {
  const top = reader.int();
  const height = Math.min(lines, data.top + data.height - top);
  if (top < data.top || height <= 0) throw new FileError('a block of this EXR file lies outside the picture: the file is damaged');
  return { left: data.left, top, width: data.width, height };
}

function tileBox(reader: Reader, tile: { width: number; height: number }, data: Box): Box {
  const [column, row, levelX, levelY] = [reader.int(), reader.int(), reader.int(), reader.int()];
  const [left, top] = [column * tile.width, row * tile.height];
  if (levelX !== 0 || levelY !== 0 || left < 0 || top < 0 || left >= data.width || top >= data.height)
    throw new FileError('a tile of this EXR file lies outside the picture: the file is damaged');
  return { left: data.left + left, top: data.top + top, width: Math.min(tile.width, data.width - left), height: Math.min(tile.height, data.height - top) };
}

/** A block's bytes: line by line, in each line channel by channel. */
async function unpack(packed: Uint8Array<ArrayBuffer>, size: number, { compression, channels }: Header, box: Box): Promise<Uint8Array> {
  // What does not get smaller is stored as it is.
  if (compression === 0 || packed.length >= size) return packed;
  switch (compression) {
    case 1:
      return reordered(unpackRuns(packed, size));
    case 2:
    case 3:
      return reordered(await inflate(packed));
    case 4:
      return unpackPiz(packed, channels, box.width, box.height);
    default:
      return unpackPxr24(await inflate(packed), channels, box);
  }
}

export async function inflate(packed: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpackRuns(packed: Uint8Array, size: number): Uint8Array {
  const bytes = new Uint8Array(size);
  let out = 0;
  for (let at = 0; at < packed.length && out < size; ) {
    const count = (packed[at++] << 24) >> 24;
    if (count < 0) {
      bytes.set(packed.subarray(at, at - count).subarray(0, size - out), out);
      at -= count;
      out -= count;
    } else {
      bytes.fill(packed[at++], out, (out += count + 1));
    }
  }
  return bytes;
}

/** Undoes the differences between neighbours, and the parting of low from high bytes. */
function reordered(bytes: Uint8Array): Uint8Array {
  for (let i = 1; i < bytes.length; i++) bytes[i] = bytes[i - 1] + bytes[i] - 128;
  const whole = new Uint8Array(bytes.length);
  const half = (bytes.length + 1) >> 1;
  for (let i = 0; i < bytes.length; i++) whole[i] = bytes[(i & 1 ? half : 0) + (i >> 1)];
  return whole;
}

/** Floats of 24 bits, as differences, in planes of bytes. */
function unpackPxr24(bytes: Uint8Array, channels: readonly Channel[], { width, height }: Box): Uint8Array {
  const size = channels.reduce((sum, { type }) => sum + bytesOf(type), 0) * width * height;
  const whole = new DataView(new ArrayBuffer(size));
  let at = 0;
  let out = 0;
  for (let y = 0; y < height; y++) {
    for (const { type } of channels) {
      const planes = type === 'half' ? 2 : type === 'float' ? 3 : 4;
      let value = 0;
      for (let x = 0; x < width; x++, out += bytesOf(type)) {
        let step = 0;
        for (let plane = 0; plane < planes; plane++) step = (step << 8) | bytes[at + plane * width + x];
        value = (value + (type === 'float' ? step << 8 : step)) | 0;
        if (type === 'half') whole.setUint16(out, value & 0xffff, true);
        else whole.setInt32(out, value, true);
      }
      at += planes * width;
    }
  }
  return new Uint8Array(whole.buffer);
}

/** Puts a block's values where they belong in the display window; what lies outside is not shown. */
function scatter(bytes: Uint8Array, box: Box, { channels, display }: Header, planes: readonly Float32Array[]): void {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const half = halfTable();
  let at = 0;
  for (let y = 0; y < box.height; y++) {
    const row = box.top + y - display.top;
    channels.forEach(({ type }, index) => {
      const plane = planes[index];
      for (let x = 0; x < box.width; x++, at += bytesOf(type)) {
        const column = box.left + x - display.left;
        if (row < 0 || row >= display.height || column < 0 || column >= display.width) continue;
        const to = row * display.width + column;
        if (type === 'half') plane[to] = half[view.getUint16(at, true)];
        else plane[to] = type === 'float' ? view.getFloat32(at, true) : view.getUint32(at, true);
      }
    });
  }
}

function readHeader(reader: Reader, isTiled: boolean): Header {
  const header: Partial<Header> & Pick<Header, 'attributes' | 'tile'> = { attributes: {}, tile: null };
  for (let name = reader.text(); name !== ''; name = reader.text()) {
    const type = reader.text();
    const size = reader.int();
    const end = reader.at + size;
    if (size < 0) throw new FileError('the header of this EXR file is damaged');
    if (name === 'channels') header.channels = readChannels(reader);
    else if (name === 'compression') header.compression = reader.byte();
    else if (name === 'dataWindow') header.data = readBox(reader);
    else if (name === 'displayWindow') header.display = readBox(reader);
    else if (name === 'tiles') header.tile = { width: reader.int(), height: reader.int() };
    else if (type === 'string') header.attributes[name] = new TextDecoder().decode(reader.bytes(size));
    else if (type === 'float') header.attributes[name] = reader.float();
    else if (type === 'int') header.attributes[name] = reader.int();
    reader.at = end;
  }
  const { channels, compression, data, display, tile, attributes } = header;
  if (!channels?.length || compression === undefined || !data || !display) throw new FileError('the header of this EXR file lacks its channels or its size');
  if (LINES[compression] === undefined)
    throw new FileError(`EXR compression ${COMPRESSIONS[compression] ?? compression} is not read here; save it with ZIP, PIZ, RLE or none`);
  if (attributes.type === 'deepscanline' || attributes.type === 'deeptile') throw new FileError('deep EXR files are not read here: flatten it first');
  const hasTiles = isTiled || attributes.type === 'tiledimage';
  if (hasTiles && !(tile && tile.width > 0 && tile.height > 0)) throw new FileError('the header of this EXR file lacks the size of its tiles');
  return { channels, compression, data, display, tile: hasTiles ? tile : null, attributes };
}

function readChannels(reader: Reader): Channel[] {
  const channels: Channel[] = [];
  for (let name = reader.text(); name !== ''; name = reader.text()) {
    const type = TYPES[reader.int()];
    reader.at += 4;
    const [x, y] = [reader.int(), reader.int()];
    if (!type) throw new FileError(`channel ${name} of this EXR file has a type that is none of uint, half and float`);
    if (x !== 1 || y !== 1) throw new FileError(`channel ${name} has a value for every ${x} × ${y} pixels; channels at full size are read here`);
    channels.push({ name, type });
  }
  return channels;
}

function readBox(reader: Reader): Box {
  const [left, top, right, bottom] = [reader.int(), reader.int(), reader.int(), reader.int()];
  if (right < left || bottom < top) throw new FileError(`a window of this EXR file is empty: from (${left}, ${top}) to (${right}, ${bottom})`);
  return { left, top, width: right - left + 1, height: bottom - top + 1 };
}

/** Little endian, from the front; raises RangeError beyond the end. */
class Reader {
  at = 0;
  private readonly view: DataView<ArrayBuffer>;

  constructor(file: ArrayBuffer) {
    this.view = new DataView(file);
  }

  peek = (): number => this.view.getUint8(this.at);
  byte = (): number => this.view.getUint8(this.at++);
  int = (): number => this.view.getInt32((this.at += 4) - 4, true);
  float = (): number => this.view.getFloat32((this.at += 4) - 4, true);
  long = (): number => Number(this.view.getBigUint64((this.at += 8) - 8, true));

  bytes(size: number): Uint8Array<ArrayBuffer> {
    if (size < 0 || this.at + size > this.view.byteLength) throw new RangeError('beyond the end');
    return new Uint8Array(this.view.buffer, (this.at += size) - size, size);
  }

  text(): string {
    const start = this.at;
    while (this.byte() !== 0);
    return new TextDecoder().decode(new Uint8Array(this.view.buffer, start, this.at - 1 - start));
  }
}
