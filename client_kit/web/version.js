/** The version of this client, as servers see it: client_kit.__version__. */
export const VERSION = "0.2.0";

/** The name under which it enrols. */
export const APP = "frontrunner-web";
