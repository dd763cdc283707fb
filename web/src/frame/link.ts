/**
 * Whether the link carries whole pictures, judged anew by every picture that comes over it. A whole one that took too long
 * makes it slow; 2×2 means, a quarter of the bytes, tell when whole ones would be quick again.
 */
export const SLOW_TRANSFER_MS = 1500;
const MOST_PATIENCE = 64;

export class Link {
  private isSlow = false;
  /** So many small pictures in a row must promise a quick whole one; doubled by each promise that was not kept. */
  private patience = 1;
  private promised = 0;
  private isTrial = false;

  /** What to ask for next. */
  get reduce(): 1 | 2 {
    return this.isSlow ? 2 : 1;
  }

  /** A picture has come: after `linkMilliseconds` in all, of which its bytes took `bodyMilliseconds`. */
  note(reduce: 1 | 2, linkMilliseconds: number, bodyMilliseconds: number): void {
    if (reduce === 1) {
      this.isSlow = linkMilliseconds > SLOW_TRANSFER_MS;
      if (!this.isSlow) this.patience = 1;
      else if (this.isTrial) this.patience = Math.min(2 * this.patience, MOST_PATIENCE);
      this.isTrial = false;
      this.promised = 0;
      return;
    }
    const whole = linkMilliseconds + 3 * bodyMilliseconds;
    this.promised = whole <= SLOW_TRANSFER_MS ? this.promised + 1 : 0;
    if (this.promised < this.patience) return;
    this.isSlow = false;
    this.isTrial = true;
  }
}
