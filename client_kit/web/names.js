/** Configurations and stages by names for people who do not know what is measured. */

import { gettext } from "./language.js";

const STAGES = new Map([
  ["preprocessing", gettext("preprocessing")],
  ["tracking", gettext("tracking")],
  ["integration", gettext("integration")],
  ["raycasting", gettext("raycasting")],
]);
const CONFIGURATIONS = new Map([
  ["best", gettext("the tuned version")],
  ["default", gettext("the default")],
  ["adaptive", gettext("the adaptive version")],
]);

/**
 * @param {string} configuration
 * @returns {string}
 */
export function nameOf(configuration) {
  return CONFIGURATIONS.get(configuration) ?? configuration;
}

/**
 * @param {string} stage
 * @returns {string}
 */
export function nameOfStage(stage) {
  return STAGES.get(stage) ?? stage;
}
