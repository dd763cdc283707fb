/** What is common to all chapters: the surface that the pixel shows, what is pointed at, what is drawn on the picture. */
import type { Component } from 'svelte';
import type { FirstVertex } from '../api/types';
import { Asked } from './asked.svelte';

/** A term of a formula: pointed at, it lights up wherever it is drawn. */
export type Term = string;

export interface Line {
  from: readonly [number, number];
  to: readonly [number, number];
  isHidden: boolean;
  isChosen: boolean;
  terms: readonly Term[];
}

export interface Mark {
  at: readonly [number, number];
  look: 'dot' | 'hollow' | 'cross';
  label: string;
  /** Radius in pixels of the page. */
  size: number;
  /** 0…1: how light; null for the accent. */
  shade: number | null;
  isChosen: boolean;
  terms: readonly Term[];
}

/** In pixels of the scene's picture. */
export interface Drawing {
  lines: readonly Line[];
  marks: readonly Mark[];
}

class Pointed {
  term = $state<Term | null>(null);
  drawing = $state.raw<Drawing | null>(null);
}

export const surface = new Asked<FirstVertex>();
export const pointed = new Pointed();

export type ChapterComponent = Component<Record<string, never>>;
