// The deformation of the films: residuals of the marks of one photo, and the mean over the roll.
import { element, number } from "/pages/words.js";

export const filmPart = (found) => element("p", {}, number(found.photos.length, 0));
