/**
 * The device's description by this browser: no guesses, null where unknown.
 *
 * Chromium names the model of an Android device. Safari and Firefox do not: the owner may choose it.
 */

/** @typedef {import("./gpu-device.js").AdapterInfo} AdapterInfo */
/** @typedef {Record<string, string | null>} Identity */

const SYSTEMS = /** @type {[RegExp, string, RegExp | null][]} */ ([
  [/Android/, "Android", /Android (\d+(?:\.\d+)*)/],
  [/iPhone/, "iOS", /OS (\d+(?:_\d+)*) like Mac/],
  [/iPad/, "iPadOS", /OS (\d+(?:_\d+)*) like Mac/],
  [/Windows/, "Windows", null],
  [/Mac OS X/, "macOS", null],
  [/CrOS/, "ChromeOS", null],
  [/Linux/, "Linux", null],
]);
const BROWSERS = /** @type {[string, RegExp][]} */ ([
  ["Edge", /Edg(?:A|iOS)?\/(\d+)/],
  ["Samsung Internet", /SamsungBrowser\/(\d+)/],
  ["Opera", /OPR\/(\d+)/],
  ["Firefox", /(?:Firefox|FxiOS)\/(\d+)/],
  ["Chrome", /(?:Chrome|CriOS)\/(\d+)/],
  ["Safari", /Version\/(\d+).* Safari/],
]);
const HANDHELD = new Set(["Android", "iOS", "iPadOS"]);
const HINTS = ["architecture", "model", "platformVersion"];

/**
 * The name and the major version of the browser.
 * @param {string} [agent]
 * @returns {{name: string | null, version: string | null}}
 */
export function browserOf(agent = navigator.userAgent) {
  for (const [name, pattern] of BROWSERS) {
    const version = pattern.exec(agent)?.[1];
    if (version) return { name, version };
  }
  return { name: null, version: null };
}

/**
 * The operating system. A desktop's version is frozen in every browser, so it is left out.
 * @param {string} [agent]
 * @returns {{name: string | null, version: string | null}}
 */
export function systemOf(agent = navigator.userAgent) {
  for (const [known, name, version] of SYSTEMS) {
    if (known.test(agent)) return { name, version: version?.exec(agent)?.[1].replaceAll("_", ".") ?? null };
  }
  return { name: null, version: null };
}

/**
 * The device fields of a submission. `adapter` is WebGPU's, `stated` the model that its owner chose.
 * @param {AdapterInfo | null} adapter
 * @param {{manufacturer: string, model: string} | null} stated
 * @returns {Promise<Identity>}
 */
export async function identify(adapter, stated) {
  const browser = browserOf();
  const system = systemOf();
  const hints = await highEntropyHints();
  const apple = system.name === "iOS" || system.name === "iPadOS";
  const model = stated?.model ?? (hints.model || null);
  return {
    os: system.name,
    // Browsers freeze Android's version in their name at 10: only the hint tells it.
    os_version: system.name === "Android" ? hints.platformVersion || null : system.version,
    manufacturer: stated?.manufacturer ?? (apple ? "Apple" : null),
    model,
    model_source: stated ? "owner" : model && "browser",
    architecture: hints.architecture || null,
    cpu_count: textOf(navigator.hardwareConcurrency),
    memory_gib: textOf(/** @type {any} */ (navigator).deviceMemory),
    gpu_vendor: adapter?.vendor || null,
    gpu_architecture: adapter?.architecture || null,
    gpu_device: adapter?.device || null,
    gpu_description: adapter?.description || null,
    gpu_fallback: adapter?.fallback ? "true" : null,
    browser: browser.name,
    browser_version: browser.version,
  };
}

/**
 * Whether the device has a well-known model: a PC's model says little.
 * @param {Identity} device
 * @returns {boolean}
 */
export function isHandheld({ os }) {
  return os !== null && HANDHELD.has(os);
}

/**
 * Chromium's user-agent data; empty elsewhere.
 * @returns {Promise<Record<string, string>>}
 */
async function highEntropyHints() {
  const agent = /** @type {any} */ (navigator).userAgentData;
  try {
    return agent ? await agent.getHighEntropyValues(HINTS) : {};
  } catch {
    return {}; // not permitted
  }
}

/**
 * @param {unknown} value
 * @returns {string | null}
 */
function textOf(value) {
  return value === undefined || value === null ? null : String(value);
}
