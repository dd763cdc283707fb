/** Keeps address and bench in step: a link opens what it names, and what is looked at can be sent as a link. */
import { type Address, addressOf, hashOf } from './address';
import { learn } from './learn.svelte';
import { workbench } from './workbench.svelte';

class Route {
  page = $state<Address['page']>('start');
}

export const route = new Route();

export function followAddress(page: Window): () => void {
  const onChange = (): void => {
    const address = addressOf(page.location.hash);
    route.page = address.page;
    switch (address.page) {
      case 'start':
        workbench.select(null);
        break;
      case 'job':
        workbench.select(address.id, address.against);
        workbench.mode = address.mode;
        workbench.layout = address.layout;
        workbench.setExposure(address.exposure);
        workbench.lookAs(address.look ?? {});
        break;
      case 'learn':
        learn.open(address);
        break;
    }
  };
  page.addEventListener('hashchange', onChange);
  onChange();
  const stopWriting = $effect.root(() => {
    $effect(() => {
      const address = shown();
      if (address && page.location.hash !== hashOf(address)) page.history.replaceState(null, '', hashOf(address));
    });
  });
  return () => {
    stopWriting();
    page.removeEventListener('hashchange', onChange);
  };
}

/** What is looked at now, as an address. Null where nothing is chosen: the address stays as it is. */
function shown(): Address | null {
  if (route.page === 'learn') return learn.address;
  const { selectedId, againstId, mode, layout, exposure, look } = workbench;
  if (selectedId === null) return null;
  return { page: 'job', id: selectedId, mode, exposure, against: againstId, layout, look };
}

/** Goes to a job and keeps the way it is looked at. */
export function openJob(page: Window, id: string): void {
  page.location.hash = hashOf({ page: 'job', id, mode: workbench.mode, exposure: workbench.exposure, against: null, layout: workbench.layout, look: workbench.kept });
}

/** Selects without a history entry: used for the first job shown. */
export function replaceAddress(page: Window, id: string): void {
  page.history.replaceState(null, '', hashOf({ page: 'job', id, mode: 'image', exposure: 0, against: null, layout: 'wipe' }));
  route.page = 'job';
  workbench.select(id);
}
