/** Who asks, where the service wants keys. Without keys everyone may do everything. */
import { getJson } from '../api/client';
import { Problem } from '../api/problem';
import type { Session as Told } from '../api/types';

class Session {
  private told = $state.raw<Told | null>(null);

  /** The key's name; null where no keys are asked for. */
  readonly client: string | null = $derived(this.told?.keys_required ? this.told.client : null);
  readonly canSubmit: boolean = $derived(this.told === null || this.told.role !== 'read');

  /** Reads the session. A key that opens nothing any more leads to the form that asks for one. */
  async check(page: Window): Promise<void> {
    try {
      this.told = await getJson<Told>('api/session');
    } catch (cause) {
      if (cause instanceof Problem && cause.status === 401) page.location.assign('login');
      // Anything else is the connection's to tell.
    }
  }

  /** Forgets the key in this browser. */
  async leave(page: Window): Promise<void> {
    await fetch('api/session', { method: 'DELETE' }).catch(() => undefined);
    page.location.assign('login');
  }
}

export const session = new Session();
