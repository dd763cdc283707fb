/** One ticking clock for "time since"; a tick a second, and none while the page is hidden. */
class Clock {
  now = $state(Date.now());
  monotonic = $state(performance.now());

  start(): () => void {
    const timer = setInterval(() => {
      if (document.visibilityState === 'hidden') return;
      this.now = Date.now();
      this.monotonic = performance.now();
    }, 1000);
    return () => clearInterval(timer);
  }
}

export const clock = new Clock();
