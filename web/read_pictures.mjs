// For tests: `node read_pictures.mjs`, JSON questions line by line, answered by the page's own modules.
import { readFileSync } from 'node:fs';
import { createInterface } from 'node:readline';
import { createServer } from 'vite';

const server = await createServer({ server: { middlewareMode: true, hmr: false, ws: false }, appType: 'custom', logLevel: 'error', optimizeDeps: { noDiscovery: true } });
const load = (name) => server.ssrLoadModule(`/src/files/${name}.ts`);
const [{ readPicture }, { compare, ssim, mainOf }, { hdrFlip, ldrFlip }, { numbersIn }, { layersOf }] = await Promise.all(
  ['read', 'metrics', 'flip', 'regions', 'raster'].map(load),
);

const open = async (path) => {
  const bytes = readFileSync(path);
  return readPicture(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
};

const answers = {
  async read({ path }) {
    const { width, height, planes, attributes } = await open(path);
    return { width, height, attributes, layers: layersOf(planes.keys()), planes: Object.fromEntries([...planes].map(([name, plane]) => [name, [...plane].map(String)])) };
  },
  async compare({ path, reference }) {
    return compare(await open(path), await open(reference));
  },
  async flip({ path, reference }) {
    const [a, r] = [await open(path), await open(reference)];
    const { width, height } = a;
    const error = ldrFlip(mainOf(r), mainOf(a), width, height);
    return { ldr: [...error], hdr: hdrFlip(mainOf(r), mainOf(a), width, height), ssim: ssim(mainOf(a), mainOf(r), width, height) };
  },
  async region({ path, region }) {
    return numbersIn(await open(path), region);
  },
};

for await (const line of createInterface({ input: process.stdin })) {
  const question = JSON.parse(line);
  const answer = await answers[question.kind](question).then((value) => ({ value }), (cause) => ({ error: cause.message }));
  process.stdout.write(`${JSON.stringify(answer)}\n`);
}
await server.close();
