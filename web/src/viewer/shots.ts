/** The view as it is shown, as a file or on the clipboard. */
import { workbench } from '../state/workbench.svelte';
import { pictureCanvas } from './canvas';

/** Without marks, at the size that it has on the screen. */
export async function saveView(): Promise<void> {
  try {
    const address = URL.createObjectURL(await pictureCanvas.shoot());
    const link = document.createElement('a');
    link.href = address;
    const what = [workbench.a.name.replace(/\.[a-z]+$/i, ''), workbench.layer, workbench.shownMode === 'image' ? '' : workbench.shownMode];
    link.download = `${what.filter(Boolean).join('-').replace(/[^\p{L}\p{N}_-]+/gu, '-')}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 60_000);
    workbench.say(`Saved as ${link.download}.`);
  } catch (cause) {
    workbench.say(`The view was not saved: ${cause instanceof Error ? cause.message : String(cause)}.`);
  }
}

export async function copyView(): Promise<void> {
  try {
    // Plain http under a name of the network has no clipboard.
    if (!navigator.clipboard?.write) throw new Error('this browser gives no clipboard here; save the view instead');
    await navigator.clipboard.write([new ClipboardItem({ 'image/png': pictureCanvas.shoot() })]);
    workbench.say('Copied as a picture.');
  } catch (cause) {
    workbench.say(`The view was not copied: ${cause instanceof Error ? cause.message : String(cause)}.`);
  }
}
