/** The address: `#/jobs/ID`. A hash needs no help from the server and works behind any prefix. */
import { workbench } from './workbench.svelte';

export function jobIdOf(hash: string): string | null {
  const match = /^#\/jobs\/([^/]+)$/.exec(hash);
  return match ? decodeURIComponent(match[1]) : null;
}

export const jobAddress = (id: string): string => `#/jobs/${encodeURIComponent(id)}`;

export function followAddress(page: Window): () => void {
  const onChange = (): void => {
    workbench.selectedId = jobIdOf(page.location.hash);
  };
  page.addEventListener('hashchange', onChange);
  onChange();
  return () => page.removeEventListener('hashchange', onChange);
}

/** Selects without a history entry: used for the first job shown. */
export function replaceAddress(page: Window, id: string): void {
  page.history.replaceState(null, '', jobAddress(id));
  workbench.selectedId = id;
}
