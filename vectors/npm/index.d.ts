/** A case: its fields by kind are described in README.md and schema.json. */
export interface Case {
  id: string;
  result: 'valid' | 'invalid' | 'acceptable';
  comment: string;
  reason?: string;
  fails?: 'encode' | 'decode' | 'compare';
  flags?: string[];
  [field: string]: unknown;
}

export interface VectorFile {
  /** As "rtu/crc16". */
  name: string;
  subject: string;
  kind: string;
  notes: string[];
  cases: Case[];
}

export interface Operation {
  given: string[];
  gives: string[];
  inside?: Record<string, string[]>;
}

export const version: string;
export const kinds: Record<string, Record<string, Operation>>;
export const schema: object;
/** The digest of each case, by id. */
export const index: Record<string, string>;
/** Which verdicts can change for a stack that passed the version `since`: ids by effect, numbers for each profile. */
export interface Verdicts {
  since: string;
  new: string[];
  'new-open': string[];
  tightened: string[];
  loosened: string[];
  changed: string[];
  reasked: string[];
  profiles: Record<string, Record<string, number>>;
}
/** By version: the ids of added cases, and of corrected ones with the reason; the newest has `verdicts`. */
export const changes: Record<string, { added: string[]; corrected: Record<string, string>; verdicts?: Verdicts }>;
export interface CaseOfFile {
  id: string;
  kind: string;
  file: string;
  case: Case;
}

export interface Profile {
  about: string;
  kinds?: string[];
  files?: string[];
  without_kinds?: string[];
  without?: string[];
  without_lines?: string[];
  first?: number;
}

export const files: VectorFile[];
export const cases: CaseOfFile[];
export const profiles: Record<string, Profile>;
/** The cases of a profile. */
export function inProfile(name: string): CaseOfFile[];
/** Whether a text fits a pattern, in which * stands for any characters. */
export function fits(pattern: string, text: string): boolean;

export interface Asked extends Pick<Case, 'result' | 'reason' | 'fails' | 'flags'> {
  /** The id of the case. */
  case: string;
  /** The line that an adapter reads. */
  question: { id: string; kind: string; do: string; [field: string]: unknown };
  expected: Record<string, unknown>;
}

/** All questions; they are read at each call. */
export function questions(): Asked[];
