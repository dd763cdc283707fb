/** A file as a picture, whichever of the two formats it has. */
import { isExr, readExr } from './exr';
import { isHdr, readHdr } from './hdr';
import { FileError, type Raster } from './raster';

/** Raises FileError. */
export async function readPicture(file: ArrayBuffer): Promise<Raster> {
  if (isExr(file)) return readExr(file);
  if (isHdr(file)) return readHdr(file);
  throw new FileError('this is neither an OpenEXR nor a Radiance .hdr file, whatever its name says');
}
