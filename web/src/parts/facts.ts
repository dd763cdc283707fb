/** Requirements as lines of a table, whatever fields they have. */

/** Shown elsewhere, or of no use to a reader. */
const ELSEWHERE = new Set(['warnings', 'unsupported', 'name', 'digest', 'width', 'height', 'load_seconds', 'low', 'high', 'is_coloured', 'parameters', 'sensor_choices']);

export function factsOf(requirements: object, bytes: (n: number) => string): [string, string][] {
  const facts: [string, string][] = [];
  for (const [key, value] of Object.entries(requirements)) {
    if (ELSEWHERE.has(key)) continue;
    const shown = key.endsWith('_bytes') && typeof value === 'number' && value > 0 ? bytes(value) : inWords(value, key);
    if (shown !== '') facts.push([key.replace(/_bytes$/, '').replaceAll('_', ' '), shown]);
  }
  return facts;
}

function inWords(value: unknown, key: string): string {
  if (value === null || value === false || value === 0 || value === '') return '';
  if (value === true) return 'yes';
  if (typeof value === 'number') return key === 'max_depth' && value < 0 ? 'unlimited' : value.toLocaleString('en');
  if (Array.isArray(value)) return value.map((entry) => inWords(entry, '')).join(', ');
  if (typeof value === 'object') {
    return Object.entries(value as object)
      .map(([name, entry]) => (entry === 1 ? name : `${String(entry)} × ${name}`))
      .join(', ');
  }
  return String(value);
}
