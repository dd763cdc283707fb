/** The Learn view's choice: which scene and which pixel. */
class Learn {
  sceneName = $state<string | null>(null);
  pixel = $state.raw<{ x: number; y: number } | null>(null);

  open(scene: string | null, pixel: { x: number; y: number } | null): void {
    this.sceneName = scene;
    this.pixel = pixel;
  }
}

export const learn = new Learn();
