// What outlives a page: the request that is being written, and the originals of this session's jobs.
export const draft = { file: null, logo: null, font: null, params: { text: "" }, regions: [] };

/** By a job's address: the file that was sent. Nothing of it is stored. */
export const originals = new Map();
