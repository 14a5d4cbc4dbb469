// What the desk tells its pages, as `ui/review` writes it, and a few names the pages share.
// Types only: this file is read by the checker and served to nobody.

/** Two numbers of one frame: east and north, column and row, or x and y of a screen. */
type Pair = number[];
/** A point and the photo it is measured in. */
type Key = [point: string, photo: string];
type State = "auto" | "accepted" | "rejected" | "dubious" | "unused" | "predicted" | "proposed";
type Context = CanvasRenderingContext2D;
/** Rows of an affine map: [[a, b, x], [c, d, y]]. */
type Affine = number[][];
type Send = (message: Record<string, unknown>, after?: () => void) => boolean;

/** What the engine said: finished, or a sentence with its figures. */
type Told = string | { said: string; values: Record<string, unknown> };

interface Start {
  name: string;
  version: string;
  edition: string;
  seat: string;
  guest: boolean;
  /** Of the lessons: the address that lets a student in. */
  invitation: string;
  language: string;
  words: Record<string, string>;
  /** What the engine says, by the English sentence; empty in English. */
  messages: Record<string, string>;
  keys: [key: string, word: string][];
  palette: Record<"current" | "check" | "predicted" | "peak" | "ellipse" | "bare", string>
    & Record<"sizes" | "rays", string[]> & {
      states: Record<State, { colour: string; glyph: string }>;
      chosen: Record<"dark" | "light", string>;
    };
  photos: string[];
  /** On the start page: who closed the desk for it, and the mark of that page. */
  left?: { who: string; mark: string } | null;
  /** Width and height are those of the ortho, metres from the lattice's corner. */
  lattice: {
    west: number; north: number; pixel: number; levels: number; width: number; height: number;
  };
  ortho?: boolean;
  /** Of other orthos and mosaics the own one may be compared with, in their order. */
  years?: number[];
  /** The folder may not be written: nothing can be decided. */
  looking?: boolean;
  /** Whether photos can be placed by clicks at this desk. */
  placeable?: boolean;
  ortho_pixel: number;
  /** Half the side of the compared patch, metres; 0 or nothing where none is known. */
  template: number | null;
  results: boolean;
  /** What the block can be exported to: titles by name. */
  formats: Record<string, string>;
  /** Those whose pixels are of scans laid upright. */
  upright: string[];
  /** What can be brought of other programs: titles by name. */
  imports: Record<string, string>;
  /** Whether estimating cameras, and leaving out gross errors, is chosen here; empty if neither. */
  free: boolean[];
  /** Whether marks can be found by an example. */
  fill: boolean;
  /** On the placing page only. */
  scans: ScanToPlace[];
  command: string;
}

/** point, photo, role, state, decided by hand, doubt, misfit px, score; metres in dispute, misfit in sigmas */
type Row = [string, string, string, State, number, number, number | null, number | null,
  disputed: number | null, sigmas: number | null, readings: number,
  east: number, north: number, unchecked: number];
interface Filter { state: string; photo: string; role: string; text: string; area: Pair[] }
interface Sort { column: string; descending: boolean }
interface Queue {
  current: number;
  taken: [row: number, name: string][];
  filter: Filter;
  sort: Sort;
  explaining: Key[];
  /** The question before a weighty decision is taken back. */
  turning: Notice | null;
  /** Rows with a draft of one's own. */
  drafts: number[];
}
/** The queue with what the page itself finds out about it. */
interface SiftedQueue extends Queue {
  counts: Record<string, number>;
  shown: number[];
  isTaken: Map<number, string>;
  drafted: Set<number>;
}

interface Checks {
  count: number;
  least: number;
  kept: number;
  kept_rmse: number | null;
}

interface Status {
  sigma: number | null;
  sigma_before: number | null;
  mp: number | null;
  mp_before: number | null;
  checks: Checks;
  converged: boolean;
  counts: Record<string, number>;
  decided: number;
  drafts: number;
  operator: string;
  people: [name: string, key: Key | []][];
  adjusting: boolean;
  stale: string[];
  written: boolean;
  written_ms: number;
  remaking: Making | null;
  filling: Making | null;
}

interface Figures {
  ratio: number | null;
  misfit: Pair | null;
  misfit_before: Pair | null;
  ground: Pair | null;
  residual: Pair | null;
  sigma: number | null;
  score: number | null;
  hand: boolean;
  redundancy: number | null;
  place: Pair;
  source: string;
  surveyed: number[];
  surveyed_sigma: number[];
  remark: string;
}
interface Trial {
  rejects: boolean;
  sigma: number | null;
  now: number | null;
  shift: number | null;
  photo: string;
  /** Other measurements that would be left out. */
  out: Key[];
  neighbours: [point: string, photo: string, now: number, then: number][];
}
interface HistoryItem {
  id: string;
  when: string;
  who: string;
  what: string;
  detail: [word: string, values: Record<string, string>];
  stands: boolean;
  /** Whether the operator of this page may take it back. */
  turns: boolean;
  by: string;
}
interface Point {
  key: Key;
  role: string;
  state: State;
  scan: { size: Pair; version: number; pixel: number };
  /** Metres east and north. */
  marks: { surveyed: Pair; predicted: Pair; measured: Pair; peaks: Pair[] };
  /** Pixels of the raw scan, and its pixels per metre east and north. */
  raw: { predicted: Pair; measured: Pair; peaks: Pair[]; matrix: number[][] };
  /** A place not decided yet: metres, pixels of the raw scan, and whether it is asked about. */
  draft: { place: Pair; raw: Pair; asking: boolean; opponent: string } | null;
  figures: Figures;
  why: [word: string, value: string][];
  peaks: { score: number | null; operator: string; away: number }[];
  /** Nadir, isocentre and so on by letter: pixels of the raw scan, metres east and north. */
  specials: [letter: string, raw: Pair, ground: Pair][];
  /** Where a point of the user lies in all likelihood: what a unit circle becomes, scan pixels. */
  ellipse: number[][] | null;
  /** Places of several operators, pixels of the raw scan. */
  readings: { who: string; raw: Pair }[];
  /** Every scan that shows the point, best view first; where it lies there, metres. */
  others: {
    photo: string; state: State; misfit: number | null; version: number; hidden: boolean;
    score: number | null; at: Pair | null;
  }[];
  ahead: [photo: string, version: number, east: number, north: number][];
  /** Its photo was rejected: no verdict changes anything. */
  idle: boolean;
  /** Only yes or no applies: nothing is placed. */
  fixed: boolean;
  trial: Trial | null;
  history: HistoryItem[];
}

interface Milestone {
  number: number;
  decided: number;
  used: number;
  sigma: number;
  mp: number | null;
  rms: Record<string, number>;
}
interface Quality {
  verdict: number;
  /** Whether the rules on disk cannot be read. */
  broken: boolean;
  findings: [word: string, grave: number, values: Record<string, string>][];
  sigma: number | null;
  mp: number | null;
  checks: Checks;
  free: boolean[];
  photos: {
    photo: string; oriented: boolean; tilt: number | null; crab: number | null; rms: number | null;
    control: number; ties: number; sigma: number | null; cells: number[];
  }[];
  overlaps: [string, string, share: number, ties: number, along: boolean | null][];
  rays: [rays: number, count: number][];
  /** Mean residuals on the film, top row of it first: x right, y up, micrometres. */
  pattern: (number | null)[][][];
  pattern_counts: number[][];
  control_cells: number[][];
  map: {
    origin: Pair;
    bounds: number[];
    outlines: Record<string, Pair[]>;
    control: [...(number | null)[], point: string, photo: string | null][];
    checks: (number | null)[][];
    ties: [x: number, y: number, sigma: number | null][];
  };
  milestones: Milestone[];
  read: ReadFigures | null;
  /** How many map sheets there are, and the sample that decides for all. */
  sheets: { count: number; sample: Sample | null };
  /** The observer still reads, so that nothing of what readings say is told. */
  reads: boolean;
  rules: [rule: string, grave: number, word: string, values: Record<string, string>,
    value: string, limit: string, source: string][];
  /** Tilt and crab that a photo may have as a rule, degrees. */
  turned: Pair;
  signatures: Signature[];
  /** Digest of each part that a signature is about. */
  judged: Record<string, string>;
  compared: { pair: [number, number]; shifts: [photo: string, metres: number][] } | null;
}

/** A map sheet that was drawn, and why it is good or bad. */
interface SampledSheet {
  name: string; state: "good" | "bad" | "open"; faults: number; read: number; m_p: number | null;
  interval: (number | null)[]; by_readings: string;
  said: { id: number; who: string; when: string; good: boolean; words: string;
    outdated: boolean }[];
  /** Easting and northing, metres. */
  rings: Pair[][];
}
/** A sample of map sheets; shares of bad sheets and of accepted lots are per cent. */
interface Sample {
  when: string; who: string; seed: number; digest: string; unchanged: boolean; changed: boolean;
  replaced: number; rejected: number; lot: number; drawn: number; accepted: number; bad: number; open: number;
  /** Empty for an observer who still reads. */
  state: string;
  good_lot: [share: number, sheets: number, accepted: number];
  bad_lot: [share: number, sheets: number, accepted: number];
  curve: Pair[];
  sheets: SampledSheet[];
}

/** How far long work is. */
interface Making { share: number; what: string; left: number | null; cancelling: boolean }
type FiducialState = "used" | "filled" | "placed" | "hidden" | "unused" | "missing";
interface Fiducial {
  name: string;
  state: FiducialState;
  place: Pair | null;
  expected: Pair | null;
  residual: Pair | null;
  score: number | null;
  apart: number | null;
  sigma: number | null;
  doubt: number;
  why: Told[];
  said: { id: string; who: string; when: string; filled: boolean } | null;
}
interface ScanRow {
  photo: string;
  camera: string;
  certified: boolean;
  size: Pair;
  version: number;
  window: number;
  model: string;
  rms: number | null;
  doubt: number;
  why: Told[];
  cells: Fiducial[];
}
/** name, x and y mm on the film, dx and dy um after the orientation, after a similarity alone */
type FilmMark = [string, number, number, number, number, number, number];
interface Film {
  photo: string;
  camera: string;
  marks: FilmMark[];
  scale_x: number;
  scale_y: number;
  shear: number;
  rms: number;
  rms_plain: number;
  redundancy: number;
  chance: number | null;
}
interface Roll { count: number; marks: FilmMark[]; mean: number[]; spread: number[]; rms: number }
interface Films { films: Film[]; rolls: Record<string, Roll | null>; frames: Record<string, Pair> }
/** A mark that somebody showed, so that the others like it were found. */
interface Example { id: number; camera: string; photo: string; place: Pair }
/** A place of a mark that nobody has decided yet, and what keeping it would make of its scan. */
interface MarkDraft {
  photo: string;
  name: string;
  place: Pair;
  off: number | null;
  rms: number | null;
  against: boolean;
  asking: boolean;
}
interface Board { photos: ScanRow[]; films: Films; examples: Example[] }

interface PlacedPhoto {
  photo: string;
  oriented: boolean;
  source: string;
  before: Pair[] | null;
  after: Pair[] | null;
  shift: Pair | null;
  turn: number | null;
  scale: number | null;
  rms: number | null;
  why: Told[];
}
interface Placement {
  photos: PlacedPhoto[];
  set_aside: [photo: string, why: Told][];
  median: number | null;
  worst: number | null;
}

interface SceneSwitches {
  layers: Record<string, boolean>;
  /** Tie points of so many photos alone; 0 for all. */
  rays: number;
  scale: number;
  relief: number;
  /** Whether it is drawn for a light ground. */
  light: boolean;
  /** The chosen photo, and the one whose perspective centre the eye is in. */
  photo: string;
  inside: string;
  /** Of the special points of photos: nadir and so on. */
  letters: string[];
  /** Misfit at the end of the ramp of colours, metres. */
  top: number;
  /** Height of the ground, metres. */
  level: number;
}
/** What lies under the pointer in the scene: a photo, a point or nothing. */
interface Card {
  number: number;
  photo?: string;
  rms?: number | null;
  control?: number;
  ties?: number;
  point?: string;
  role?: string;
  state?: State | null;
  misfit_m?: number | null;
  misfit_px?: number | null;
  photos?: number;
}
interface Sight {
  number: number;
  place: number[];
  photos: [photo: string, nadir: number, pixel: number][];
}
/** In the local frame, metres; `slope` is the tangent of half the opening over the height. */
interface Eye {
  at: number[];
  right: number[];
  up: number[];
  forward: number[];
  slope: number;
  size: Pair;
}
/** The part of the mosaic that one photo shows, metres east and north. */
interface SeamOf { photo: string; date: string; label: Pair; rings: Pair[][] }
interface SeamDecided {
  id: number; who: string; when: string; area: boolean; what: string;
}
/** An edit that stands. */
interface SeamEdited extends SeamDecided {
  /** Its turn among those that stand, from 1: later ones lie over earlier ones. */
  turn: number;
  /** Corners, metres east and north. */
  places: Pair[];
}
/** The mosaic on disk; version 0 and nothing else where there is none. */
interface Mosaic {
  version: number;
  stale: string[];
  written?: string;
  pixel?: number;
  /** West, south, east, north, metres. */
  bounds?: number[];
  area?: number;
  seams?: SeamOf[];
  borders?: Record<string, Pair[]>;
  holes?: [east: number, north: number, area: number, why: string, scans: string[]][];
  hole_count?: number;
  /** Names the seams where edits changed them since the file was written; else 0. */
  edition?: number;
  /** Whether its file is no longer there, or another one. */
  gone?: boolean;
  /** Whether seams were edited outside of the desk and hold alone: composed, or still to be. */
  outside?: "" | "composed" | "waiting";
  /** Where: west, south, east, north, metres. */
  changed?: number[] | null;
  edits?: SeamEdited[];
  /** Edits that no longer stand, newest first. */
  withdrawn?: (SeamDecided & { by: string })[];
  /** Where the mosaic is likely wrong, worst first; metres. */
  misfits?: MisfitPlace[];
  /** Open ones first. */
  faults?: Fault[];
  sampled?: Sample | null;
}
interface Fault {
  id: number;
  place: Pair;
  /** The photo it is a fault of; empty for one of the mosaic. */
  photo: string;
  kind: string;
  open: boolean;
  assigned: string;
  said: { who: string, when: string, words: string, closes: boolean | null }[];
}
interface MisfitPlace {
  kind: "reference" | "seam" | "house" | "ground" | "ties";
  place: Pair;
  /** The one that is off, or the two that do not fit. */
  photos: string[];
  /** By which heights stand out. */
  height: number;
  shift: Pair;
  length: number;
  sigma: number;
  predicted: number;
  /** Off by more than the block predicts. */
  significant: boolean;
}
/** What a place on the mosaic leads to; photo is null where none shows it. */
interface PickedPlace {
  number: number;
  place: [east: number, north: number, height: number | null];
  photo: string | null;
  /** The photo that the mosaic shows there. */
  shown?: string;
  date?: string;
  stale?: boolean;
  pixel?: number | null;
  sigma?: Pair | null;
  others?: [photo: string, nadir: number, pixel: number][];
  points?: number;
  nearest?: number | null;
  control?: { point: string, away: number, residual: number | null, state: string }[];
  ties?: { count: number, away: number, rms: number, largest: number } | null;
}
/** A key of the catalogue with its values. */
interface Notice {
  text: string;
  values: Record<string, string>;
  grave: boolean;
  /** The draft that it is about. */
  draft?: Key | null;
}
/** The parts of the desk as they were told last. */
interface Parts {
  rows?: Row[];
  order?: number[];
  queue?: Queue;
  status?: Status;
  point?: Point | null;
  quality?: Quality;
  board?: Board;
  board_drafts?: MarkDraft[];
  /** The mark that an undo was about; the number makes it news though it was before. */
  board_mark?: [photo: string, name: string, decision: number];
  placement?: Placement;
  mask?: Masks;
  mosaic?: Mosaic;
  picked?: PickedPlace;
  checks?: CheckSheet;
  scene?: SceneSwitches;
  card?: Card;
  sight?: Sight;
}
/** Only what changed; the table in pieces `rows/0`, `rows/1` and so on, `rows/count` long. */
type Message = Parts & { notices?: Notice[]; "rows/count"?: number };

/** One planned place as one observer sees it; no place of anybody else is told. */
interface CheckedPlace {
  place: string;
  /** The place that a spare stands in for; empty of any other. */
  after: string;
  at: Pair;
  surveyed: boolean;
  /** Middles of the views of mosaic and reference. */
  views: Pair[];
  width: number;
  state: "open" | "read" | "unreadable" | "outdated";
  marks?: Pair[];
  reason?: string;
  decision?: number;
}
interface PlanLine {
  when: string; who: string; count: number; cells: number[]; source: string; digest: string;
  beforehand: boolean; unchanged: boolean;
}
interface CheckSheet {
  plan: PlanLine | null;
  mosaic: Mosaic | null;
  /** Whether its file is gone or changed. */
  gone: boolean;
  places: CheckedPlace[];
  /** So many places the observer is to read: the first ones. */
  wanted: number;
  /** Standard deviations (east, north) expected of a reading, metres. */
  sigmas: Record<string, Pair | null>;
  /** From how many of them on a reading is asked about. */
  asking: number;
}
interface ReadRow {
  count: number; mean: (number | null)[]; shifted: boolean[]; scatter: (number | null)[];
  rms: (number | null)[]; mp: number | null; interval: (number | null)[]; ce90: number | null;
  nmad: (number | null)[]; extreme: (number | null)[];
}
interface ReadFigures {
  planned: number; read: number; unreadable: number; doubled: number; together: ReadRow;
  observers: [who: string, row: ReadRow][];
  pairs: [first: string, second: string, row: ReadRow][];
  observer: number | null; share: number | null;
}
interface Signature {
  id: number; who: string; when: string; verdict: string; remark: string; digest: string;
  changed: string[];
}

/** A scan with what was drawn on it: polygons as rings of places, the outer one first. */
interface MaskedScan {
  photo: string;
  camera: string;
  size: Pair;
  version: number;
  pixel_um: number;
  hidden: number[][][][];
  freed: number[][][][];
  /** Control points that it took out of use, and those an operator holds there. */
  out: string[];
  held: string[];
}
interface Masks {
  photos: MaskedScan[];
  strokes: {
    id: number; who: string; when: string; subject: string; camera: boolean; hides: boolean;
    brush: boolean;
  }[];
  /** Rays of tie points that masks took out of use. */
  ties: number;
}

interface ScanToPlace {
  photo: string;
  size: Pair;
  version: number;
  /** Column, row, easting, northing. */
  pairs: number[][];
  why: Told;
  known: { east: number; north: number; pixel: number } | null;
}
interface PairFit {
  count?: number;
  matrix?: Affine;
  residuals?: Pair[] | null;
  rms?: number | null;
  affine?: { matrix: Affine; residuals: Pair[] | null; rms: number | null } | null;
  pixel_m?: number;
  scale?: number;
  turn_deg?: number;
  why?: Told;
}
interface RunLine {
  stage: string;
  /** How often it was walked, this time included. */
  pass: number;
  share: number;
  what: string;
  /** Of a stage that has ended. */
  seconds?: number;
  said?: Told;
  /** Seconds, of the one at work. */
  taken?: number;
  left?: number | null;
}
interface Run {
  state: "idle" | "running" | "failed" | "cancelled" | "done";
  /** It was asked to stop. */
  cancelling?: boolean;
  lines: RunLine[];
  stages: string[];
  log: Told[];
  why?: Told;
  seconds?: number;
}

interface FoundScan {
  photo: string;
  file: string;
  bytes?: number;
  size?: Pair;
  why: Told;
}
/** Something that a line of print beside the picture seems to tell. */
interface MarginField {
  name: string;
  value: string;
  text: string;
  probability: number;
  /** Of the line, pixels of the scan. */
  corners: Pair[];
  /** Key of block.toml that it would fill in; empty where there is none. */
  key: string;
}
interface FormField {
  key: string;
  kind: string;
  value: any;
  /** True when the file says it, false when it is proposed. */
  known: boolean;
  default: any;
  required: boolean;
  range: number[];
  choices: string[];
  more: boolean;
  /** What a proposal was reckoned from: `form.why.NAME` and a size in metres. */
  why?: [name: string, size: number];
}
type FormCheck = [grave: boolean, name: string, values: Record<string, unknown>];
interface Judged {
  /** By field; under no name what concerns the whole file. */
  errors: Record<string, Told>;
  missing: string[];
  ready: boolean;
  /** What of its figures is doubtful, as it stands while it is written. */
  checks?: FormCheck[];
}
interface Form extends Judged {
  sections: { table: string; kind: string; fields: FormField[] }[];
}
interface FoundBlock {
  path: string;
  run: boolean;
  written: boolean;
  why: Told;
  /** Figures of the last report; verdicts with whether they still hold. */
  sigma: number | null;
  predicted: number | null;
  m_p: number | null;
  open: number;
  signed: [who: string, verdict: string, holds: boolean][];
}
/** The last `gruber batch` over the blocks of a folder. */
interface Batch {
  /** When its table was written. */
  written: string;
  blocks: Record<string, [state: string, stage: string, message: string]>;
}
interface Found {
  folder: string;
  /** The folder of blocks it was chosen in; empty where there is none. */
  home: string;
  written: boolean;
  found: [name: string, value: string][];
  /** Each of the keys fills the gap. */
  gaps: [name: string, out: string, keys: string[]][];
  notes: [name: string, values: Record<string, string>][];
  scans: FoundScan[];
  crs: string;
  outlines: { kind: string; name: string; crs: Told; corners: Pair[] }[];
  form: Form;
  blocks: FoundBlock[];
  /** How many more there are. */
  unlisted: number;
  batch: Batch | null;
  links: string[];
  /** Files and folders that were uploaded to this page. */
  added: string[];
  checks: FormCheck[];
  /** Stages that a run would make again. */
  ahead: string[];
  made: boolean;
  placeable: boolean;
}
/** One photo or point of two blocks, or the ground of both: the second less the first. */
interface NeighbourRow {
  kind: "photo" | "point" | "ground";
  name: string;
  /** Its name in the second block. */
  other_name?: string;
  length_m: number;
  sigma_m: number | null;
  ratio: number | null;
  verdict: "agree" | "differ" | "disagree" | "unknown";
  shift_m: number[];
  shift_sigma_m?: (number | null)[];
  turn_deg?: number[];
  turn_sigma_deg?: number[];
  places?: number;
}
interface NeighbourPair {
  one: string;
  other: string;
  why: Told;
  told: number;
  rows: NeighbourRow[];
  /** Shared photos that one of both does not orient. */
  one_sided: string[];
  /** Photos of one name and size in both whose scans are two files. */
  namesakes: string[];
  /** Whether both lie on one reference. */
  same: boolean;
}
interface Neighbours {
  level: number;
  blocks: number;
  pairs: NeighbourPair[];
  left_out: { path: string; why: Told }[];
  /** Blocks that no run has brought so far, a number. */
  unadjusted: number;
}
interface Upload {
  name: string;
  file: File;
  share: number;
  why: string;
  /** While it is sent. */
  request: XMLHttpRequest | null;
}

/** Elements that are more than an HTMLElement, by their id. */
/** What a list of points leaves open. */
interface ListQuestion {
  about: string;
  words: Told;
  choices: { value: string; words: Told }[];
}

/** A list of points as it would come in. */
/** What a file of another program would bring. */
interface ReadForeign { format: string; counts: Record<string, number>; notes: Told[] }
interface ReadList {
  reading: {
    encoding: string;
    delimiter: string;
    decimal: string;
    header: boolean;
    axes: string;
    columns: string[];
    crs: string;
    role: string;
    sigma_plan_m: number;
    sigma_height_m: number;
  };
  header: string[];
  width: number;
  rows: (number | string)[][];
  evidence: Told[];
  points: [name: string, east: number, north: number, role: string][];
  replaced: number;
  refused: { number: number; text: string; cause: Told; remedy: Told }[];
  refused_count: number;
  questions: ListQuestion[];
  footprints: [east: number, north: number][][];
}

interface Ids {
  board: HTMLDialogElement;
  mask: HTMLDialogElement;
  checks: HTMLDialogElement;
  placed: HTMLDialogElement;
  contrast: HTMLInputElement;
  help: HTMLDialogElement;
  "mark-room": HTMLElement | null;
  mosaic: HTMLDialogElement;
  "mosaic-year": HTMLInputElement; "mosaic-share": HTMLInputElement;
  "name-field": HTMLInputElement;
  naming: HTMLDialogElement;
  placement: HTMLDialogElement;
  points: HTMLDialogElement;
  "points-open": HTMLButtonElement;
  quality: HTMLDialogElement;
  rate: HTMLInputElement;
  "remake-cancel": HTMLButtonElement;
  "remake-start": HTMLButtonElement;
  results: HTMLDialogElement;
  scene: HTMLIFrameElement;
  "sieve-photo": HTMLSelectElement;
  "sieve-role": HTMLSelectElement;
  "sieve-text": HTMLInputElement;
  "sort-column": HTMLSelectElement;
  swipe: HTMLInputElement;
  tour: HTMLDialogElement;
}

interface Window {
  /** Keys that viser's page hands up; true when the key is the desk's. */
  gruberKey?: (event: KeyboardEvent) => boolean;
  /** Set by viser's page: true while it is cut off from the desk. */
  gruberLost?: boolean;
  /** Asked by viser's page: is a hand at work at the desk? */
  gruberAtWork?: () => boolean;
  /** Told by viser's page after every frame. */
  gruberEye?: () => void;
  /** Closes the placing page that lies over the desk. */
  gruberPlaced?: () => void;
  /** What tests look at. */
  gruber?: object;
}

/** The page of lessons, as `app/teaching.py` tells it. */
interface LessonNumber { value: number | null; digits: number; unit: string; truth: number | null }
/** Of a symbol: a number, or a matrix. */
type LessonValue = (LessonNumber & { hue?: number }) | LessonNumber[][];
type LessonMath = string | [string, ...LessonMath[]];
interface Equation { left: string; right: LessonMath }
interface LessonSlider {
  name: string;
  low: number;
  high: number;
  start: number;
  step: number;
  unit: string;
  symbol: string;
  /** Canvas whose handle moves it; empty for a slider of its own. */
  moved_in: string;
  switch: boolean;
}
interface Lesson {
  name: string;
  letter: string;
  sliders: LessonSlider[];
  equations: Equation[];
  questions: string[];
  /** Whether something was put in that can be hidden. */
  truth: boolean;
}
/** A question with its numbers. */
interface LessonAsked {
  name: string;
  values: Record<string, number>;
  unit: string;
  /** Whether its answer has a sign. */
  signed: boolean;
}
/** An answer as the page keeps it; null is given up. */
interface LessonAttempt {
  when: string;
  lesson: string;
  which: number;
  seed: number;
  answer: number | null;
  right: boolean;
  state: Record<string, number>;
}
interface LessonShape {
  kind: "line" | "area" | "dots" | "crosses" | "arrow" | "text";
  /** Of three numbers each in space. */
  points: Pair[];
  look: string;
  label?: string;
  number?: LessonNumber;
  handle?: [across: string, up: string];
  below?: boolean;
}
interface LessonCanvas {
  name: string;
  /** Left, lower, right, upper edge; in space the corners of a box. */
  window: number[];
  shapes: LessonShape[];
  unit: string;
  equal: boolean;
  picture: { address: string; window: [number, number, number, number] } | null;
}
interface LessonPlot {
  x: string;
  y: string;
  curves: { name: string; points: Pair[]; look: string }[];
  at: Pair | null;
  /** Slider whose choices are the places along x. */
  kinds: string;
}
interface LessonView {
  figures: Record<string, LessonNumber>;
  canvases: LessonCanvas[];
  symbols: Record<string, LessonNumber | LessonNumber[][]>;
  plot: LessonPlot | null;
  /** Of a lesson in steps: what its texts are called, and its own formulas. */
  step: string;
  equations: Equation[];
  /** Sliders that move nothing now, each with its reason. */
  idle: Record<string, string>;
  /** What they show instead of where they stand. */
  in_force: Record<string, number>;
  warning: string;
}
