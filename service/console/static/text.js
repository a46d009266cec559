// Words of the page: one table a language, with the same keys.
import { useEffect, useState } from "./html.js";
import en from "./text-en.js";
import zh from "./text-zh.js";

const TABLES = { en, zh };
const CHOICE = "meshmark.language";
const listeners = new Set();

const guessed = () => (navigator.languages.find((tag) => /^(zh|en)/.test(tag)) ?? "en").slice(0, 2);
let language = localStorage.getItem(CHOICE) ?? guessed();
document.documentElement.lang = language === "zh" ? "zh-Hans" : "en";

export const currentLanguage = () => language;

export function chooseLanguage(name) {
  language = name;
  localStorage.setItem(CHOICE, name);
  document.documentElement.lang = name === "zh" ? "zh-Hans" : "en";
  for (const listener of listeners) listener(name);
}

/** Draw a component anew when the language changes. */
export function useLanguage() {
  const [name, set] = useState(language);
  useEffect(() => {
    listeners.add(set);
    return () => listeners.delete(set);
  }, []);
  return name;
}

export const has = (key) => key in TABLES[language];

/**
 * The text of a key, with {names} filled in: of KEY.one for one thing, where there is that; of a key that is not in the
 * table, `otherwise` or the key itself.
 */
export function t(key, values = {}, otherwise = key) {
  const text = (values.n === 1 ? TABLES[language][`${key}.one`] : null) ?? TABLES[language][key] ?? otherwise;
  return text.replace(/\{(\w+)\}/g, (all, name) => String(values[name] ?? all));
}

export const number = (value, digits = 0) =>
  value.toLocaleString(language === "zh" ? "zh-CN" : "en-GB", { maximumFractionDigits: digits });

export const percent = (share, digits = 0) => `${number(share * 100, digits)}${language === "zh" ? "" : "\u00a0"}%`;

export const length = (value) => Number(value.toPrecision(3)).toLocaleString("en-GB", { maximumSignificantDigits: 3 });

export function bytes(size) {
  if (size < 1000) return `${size} B`;
  if (size < 1e6) return `${number(size / 1e3)} kB`;
  return `${number(size / 1e6, 1)} MB`;
}

export const moment = (text) =>
  new Date(text).toLocaleString(language === "zh" ? "zh-CN" : "en-GB", { dateStyle: "medium", timeStyle: "short" });
