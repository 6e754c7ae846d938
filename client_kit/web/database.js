/**
 * This browser's storage: downloaded files by digest, settings by name, and measured sessions by id.
 */

import { gettext } from "./language.js";

const NAME = "frontrunner";
const VERSION = 1;
const OPENED_MS = 10_000; // until the storage has answered
const STORES = /** @type {const} */ (["files", "settings", "sessions"]);

/** @typedef {typeof STORES[number]} Store */

/** The browser does not let this page store anything, or its disk is full. */
export class StorageError extends Error {}

const SILENT = gettext("This browser's storage does not answer: close its other tabs with this page, and load the page again.");

/** @type {Promise<IDBDatabase> | null} */
let opened = null;

/** @returns {Promise<IDBDatabase>} */
function open() {
  opened ??= new Promise((resolve, reject) => {
    if (!globalThis.indexedDB) throw refused(null);
    const request = requestDatabase();
    request.onupgradeneeded = () => {
      for (const store of STORES) request.result.createObjectStore(store);
    };
    request.onsuccess = () => {
      // Another tab with a newer version of this page waits until this one closes the database.
      request.result.onversionchange = () => {
        request.result.close();
        opened = null;
      };
      resolve(request.result);
    };
    request.onerror = () => reject(refused(request.error));
    setTimeout(() => reject(new StorageError(SILENT)), OPENED_MS);
  });
  opened.catch(() => (opened = null)); // the next use tries again
  return opened;
}

/** @returns {IDBOpenDBRequest} */
function requestDatabase() {
  try {
    return indexedDB.open(NAME, VERSION);
  } catch (error) {
    throw refused(error instanceof DOMException ? error : null); // where cookies are blocked
  }
}

/**
 * @param {DOMException | null} error
 * @returns {StorageError}
 */
function refused(error) {
  if (error?.name === "QuotaExceededError") {
    return new StorageError(gettext("This browser's storage is full: free some space."));
  }
  const reason = error?.message.replace(/\.$/, "") || gettext("storage is switched off");
  const remedy = gettext("Allow this site to store data, or leave the private window.");
  return new StorageError(`${gettext("This browser cannot keep measurements: %(reason)s", { reason })}. ${remedy}`);
}

/**
 * Do WORK on a store, and wait until its changes are on disk.
 * @template T
 * @param {Store} store
 * @param {IDBTransactionMode} mode
 * @param {(store: IDBObjectStore) => IDBRequest<T>} work
 * @returns {Promise<T>}
 */
async function transact(store, mode, work) {
  const database = await open();
  return new Promise((resolve, reject) => {
    const transaction = database.transaction(store, mode, { durability: "strict" });
    const request = work(transaction.objectStore(store));
    transaction.oncomplete = () => resolve(request.result);
    transaction.onabort = () => reject(refused(transaction.error));
  });
}

/**
 * The value of KEY, undefined without one.
 * @param {Store} store
 * @param {string} key
 * @returns {Promise<any>}
 */
export function read(store, key) {
  return transact(store, "readonly", (files) => files.get(key));
}

/**
 * Every value of a store, in the order of their keys.
 * @param {Store} store
 * @returns {Promise<any[]>}
 */
export function readAll(store) {
  return transact(store, "readonly", (files) => files.getAll());
}

/**
 * Store VALUE under KEY. It is on disk when the promise resolves.
 * @param {Store} store
 * @param {string} key
 * @param {unknown} value
 */
export async function write(store, key, value) {
  await transact(store, "readwrite", (files) => files.put(value, key));
}

/**
 * Delete KEY.
 * @param {Store} store
 * @param {string} key
 */
export async function remove(store, key) {
  await transact(store, "readwrite", (files) => files.delete(key));
}

/**
 * Delete everything in a store.
 * @param {Store} store
 */
export async function clear(store) {
  await transact(store, "readwrite", (files) => files.clear());
}
