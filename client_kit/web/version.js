/** The name under which this client enrols. */
export const APP = "frontrunner-web";

/** Its version, from the page: that of the program that served it. */
export const VERSION = document.getElementById("asking")?.dataset.version ?? "";
