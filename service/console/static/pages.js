// Lists of jobs that the service gives by pages.
import { getJson } from "./api.js";
import { useEffect, useRef, useState } from "./html.js";
import { active } from "./parts.js";

const UNREAD = { items: null, next: null, pages: 0 };

/**
 * The list whose first page is at `first`: {items, problem, more, again}. `items` are null until they are read; `more`
 * reads the next page, and is null where there is none; `again` reads anew all pages that are shown, as happens by
 * itself every `pause` milliseconds while something in them runs.
 */
export function usePages(first, pause) {
  const [list, setList] = useState(UNREAD);
  const [problem, setProblem] = useState(null);
  const reader = useRef(null);
  useEffect(() => {
    let gone = false;
    let latest = 0; // of two readings at once, the one that was begun last counts
    let shown = UNREAD;
    let timer;
    const show = (pages) => setList((shown = pages));
    const read = async (start, pages) => {
      if (gone) return;
      const mine = ++latest;
      clearTimeout(timer);
      let found = start;
      try {
        do {
          const page = await getJson(found.pages ? found.next : first);
          found = { items: [...(found.items ?? []), ...page.items], next: page.next, pages: found.pages + 1 };
        } while (found.next && found.pages < pages);
      } catch (error) {
        if (gone || mine !== latest) return;
        setProblem(error);
        found = start;
      }
      if (gone || mine !== latest) return;
      if (found !== start) {
        setProblem(null);
        show(found);
      }
      if (found.items?.some(active)) timer = setTimeout(again, pause); // none after what could not be read anew
    };
    const again = () => read(UNREAD, shown.pages);
    reader.current = { again, more: () => read(shown, shown.pages + 1) };
    show(UNREAD);
    again();
    return () => {
      gone = true;
      clearTimeout(timer);
    };
  }, [first]);
  return { ...list, problem, more: list.next && (() => reader.current.more()), again: () => reader.current.again() };
}
