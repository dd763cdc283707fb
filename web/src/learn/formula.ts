/** Formulas as MathML, written as values. A part that is a term has a name: pointed at, it lights up. Pure. */
import type { Term } from './surface.svelte';

export interface Part {
  tag: string;
  of: readonly Node[];
  term?: Term;
  attributes?: Readonly<Record<string, string>>;
}
export type Node = Part | string;

const element =
  (tag: string, attributes?: Readonly<Record<string, string>>) =>
  (...of: readonly Node[]): Part => ({ tag, of, attributes });

export const mi = element('mi');
/** An upright word, as cos. */
export const word = element('mi', { mathvariant: 'normal' });
export const mo = element('mo');
export const mn = element('mn');
export const mtext = element('mtext');
export const row = element('mrow');
export const sub = element('msub');
export const sup = element('msup');
export const subsup = element('msubsup');
export const frac = element('mfrac');
export const root = element('msqrt');
export const under = element('munder');
export const underover = element('munderover');
const spread = element('mspace', { width: '0.25em' });
export const gap: Part = spread();

export const term = (name: Term, ...of: readonly Node[]): Part => ({ tag: 'mrow', of, term: name });

/** f(a, b, …) */
export const applied = (f: Node, ...values: readonly Node[]): Part =>
  row(f, mo('('), ...values.flatMap((value, i) => (i === 0 ? [value] : [mo(','), value])), mo(')'));

export const p = mi('p');
export const omega = mi('ω');
export const wi = sub(mi('ω'), mi('i'));
export const wo = sub(mi('ω'), mi('o'));
export const theta = sub(mi('θ'), mi('i'));
export const minus = mo('−');
export const equals = mo('=');
export const plus = mo('+');
export const estimate = row(mo('⟨'), mi('I'), mo('⟩'));

/** A formula in words that a screen reader can say: its symbols in a line. */
export function spoken(node: Node): string {
  if (typeof node === 'string') return node;
  const [first = '', second = '', third = ''] = node.of.map(spoken);
  switch (node.tag) {
    case 'msub':
    case 'munder':
      return `${first}_${second}`;
    case 'msup':
      return `${first}^${second}`;
    case 'msubsup':
    case 'munderover':
      return `${first}_${second}^${third} `;
    case 'mfrac':
      return `(${first})/(${second})`;
    case 'msqrt':
      return `√(${node.of.map(spoken).join('')})`;
    case 'mspace':
      return ' ';
    case 'mo':
      return ['=', '+', '−', '⇒', '∼'].includes(first) ? ` ${first} ` : first;
    default:
      return node.of.map(spoken).join('');
  }
}
