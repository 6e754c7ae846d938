/** The name under which this client enrols. */
export const APP = "frontrunner-web";

/** Its version, which the page says: that of the program that served it. */
export const VERSION = document.getElementById("asking")?.dataset.version ?? "";
