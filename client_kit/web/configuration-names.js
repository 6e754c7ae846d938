/** Configurations and stages by names for people who do not know what is measured. */

import { gettext } from "./language.js";

const NAMES = new Map([
  ["best", gettext("the tuned version")],
  ["default", gettext("the default")],
  ["adaptive", gettext("the adaptive version")],
]);

/**
 * @param {string} configuration
 * @returns {string}
 */
export function nameOf(configuration) {
  return NAMES.get(configuration) ?? configuration;
}
