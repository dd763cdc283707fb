import { expect, it } from 'vitest';
import { applied, equals, frac, gap, mi, mn, mo, p, plus, row, spoken, sub, sup, term, wi, wo } from './formula';

it('a formula is said in a line', () => {
  const emitted = sub(mi('L'), mi('e'));
  const of = row(applied(mi('L'), p, wo), equals, term('Le', applied(emitted, p, wo)), plus, sup(mi('T'), mn('2')), gap, frac(mn('1'), mi('n')));
  expect(spoken(of)).toBe('L(p,ω_o) = L_e(p,ω_o) + T^2 (1)/(n)');
  expect(spoken(row(mo('∫'), mi('f'), mo('d'), wi))).toBe('∫fdω_i');
});
