// How the search orders what it finds: pages that say how to do something stand before the reference of every name.
const FIRST = { "how-to/": 10, "tutorial/": 10, "explanation/": 8, "reference/api/": -16, "files/": -24 };
var Scorer = {
  score: ([page, , , , score]) =>
    score + (Object.entries(FIRST).find(([folder]) => page.startsWith(folder))?.[1] ?? 0),
  // The values of Sphinx.
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
