/** Sentences in the page's language. English is written where it is used; the page holds what translates it. */

const lang = document.documentElement.lang || "en";
/** Each sentence's translation; with a number, for one and for more. @type {Record<string, string | string[]>} */
const translations = JSON.parse(document.getElementById("translations")?.textContent ?? "{}");
const rules = new Intl.PluralRules(lang);
const point = new Intl.NumberFormat(lang).format(0.5).charAt(1);

/** The language of dates: in English, that of the browser. */
export const locale = lang === "en" ? undefined : lang;

/**
 * TEXT in the page's language, with VALUES for its placeholders, such as %(name)s.
 * @param {string} text
 * @param {Record<string, string | number>} [values]
 * @returns {string}
 */
export function gettext(text, values = {}) {
  return filled([translations[text] ?? text].flat()[0], values);
}

/**
 * The same for a sentence about NUMBER things: ONE of them, or MORE.
 * @param {string} one
 * @param {string} more
 * @param {number} number
 * @param {Record<string, string | number>} [values]
 * @returns {string}
 */
export function ngettext(one, more, number, values = {}) {
  const forms = [translations[one] ?? [one, more]].flat();
  return filled(forms[rules.select(number) === "one" ? 0 : 1], values);
}

/**
 * @param {string} number as JavaScript writes it
 * @returns {string} with the decimal sign of the page's language
 */
export function decimal(number) {
  return number.replace(".", point);
}

/**
 * @param {number} bytes
 * @returns {string} megabytes, rounded alike everywhere
 */
export function megabytes(bytes) {
  const number = bytes / 1e6;
  return decimal(number >= 1 ? number.toFixed(0) : number.toPrecision(1));
}

/**
 * @param {string} text
 * @param {Record<string, string | number>} values
 * @returns {string}
 */
function filled(text, values) {
  return text.replace(/%\((\w+)\)s/g, (_, name) => String(values[name]));
}
