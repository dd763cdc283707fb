/** RFC 9457 problem bodies, and the failures that have none, as one error class with a sentence to show. */
import type { FieldError } from './types';

export class Problem extends Error {
  constructor(
    readonly title: string,
    readonly detail: string,
    readonly status: number,
    readonly fields: FieldError[] = [],
  ) {
    super(detail || title);
  }

  /** Message for one form field, also where the service names it with a leading `body.`. */
  forField(name: string): string | null {
    const hit = this.fields.find((entry) => entry.field.replace(/^(body|#)?[./]?/, '').replaceAll('/', '.') === name);
    return hit ? hit.message : null;
  }
}

/** Turns a response body into a Problem; a body that is no problem document still yields a plain sentence. */
export function problemFrom(status: number, body: string): Problem {
  try {
    const parsed: unknown = JSON.parse(body);
    if (typeof parsed === 'object' && parsed !== null && ('title' in parsed || 'detail' in parsed)) {
      const record = parsed as { title?: unknown; detail?: unknown; errors?: unknown };
      const fields = Array.isArray(record.errors) ? record.errors.filter(isFieldError) : [];
      const title = typeof record.title === 'string' ? record.title : `Refused (${status})`;
      const detail = typeof record.detail === 'string' ? record.detail : title;
      return new Problem(title, detail, status, fields);
    }
  } catch {
    // Not JSON: a proxy's error page, for one.
  }
  return new Problem(`The service answered ${status}`, `The service answered ${status} without saying why. Try again.`, status);
}

export function problemOf(cause: unknown): Problem {
  if (cause instanceof Problem) return cause;
  return new Problem('The service does not answer', 'The service does not answer. Is it still running?', 0);
}

export const isAbort = (cause: unknown): boolean => cause instanceof DOMException && cause.name === 'AbortError';

function isFieldError(entry: unknown): entry is FieldError {
  if (typeof entry !== 'object' || entry === null) return false;
  const record = entry as Record<string, unknown>;
  return typeof record.field === 'string' && typeof record.message === 'string';
}
