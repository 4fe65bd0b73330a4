/** What the page and its server tell each other. Written by `python -m pomona.browser.app.typescript`; do not edit. */

export type SurveyState = "new" | "queued" | "running" | "stopping" | "stopped" | "failed" | "finished" | "missing";
export type StageState = "waiting" | "now" | "done" | "kept";
export type Metres = "nothing" | "gnss" | "markers" | "scale-bar";

/**
 * A stage of the run that is shown, in order; `seconds` is what it took, in an earlier run or so far.
 */
export interface StageView {
  name: string;
  state: StageState;
  seconds: number | null;
}

/**
 * How far a survey's run is: the present step, and how many seconds the run will take yet, about.
 *
 * `by_other`: another program works on the survey, which it must be stopped in. `message` is why the run failed.
 */
export interface RunView {
  stages: StageView[];
  label: string;
  done: number;
  total: number | null;
  leftS: number | null;
  warnings: string[];
  message: string;
  log: string[];
  byOther: boolean;
}

/**
 * A survey in the list. `day` is when its photos were taken, "" where they do not say; None: not known yet.
 *
 * `version` changes whenever pictures of the survey would. `learnt`: its segmenter learnt from it. `corrected`: its
 * fruits were corrected since they were counted and weighed.
 */
export interface SurveyView {
  id: string;
  name: string;
  folder: string;
  state: SurveyState;
  day: string;
  changed: string;
  photos: number | null;
  fruits: number | null;
  fruit: string;
  weightKg: number | null;
  learnt: boolean;
  corrected: boolean;
  version: string;
  run: RunView | null;
}

/**
 * A kind of fruit to choose, and how wide it usually is.
 */
export interface FruitChoice {
  name: string;
  diameterMm: number;
}

/**
 * What does not change while the server runs: where surveys go, kinds of fruit, forms of exports.
 *
 * `roots` are the folders below which one may choose, `home` is the one to begin with.
 */
export interface Facts {
  version: string;
  home: string;
  roots: string[];
  surveysFolder: string;
  fruits: FruitChoice[];
  exports: string[];
  canLearn: boolean;
}

/**
 * The list of surveys, told again whenever something in it changes; `facts` come with it.
 */
export interface Everything {
  facts: Facts;
  surveys: SurveyView[];
}

/**
 * A folder, or a file that is asked for, in a list to choose from; `photos` are those directly in it.
 */
export interface Place {
  name: string;
  path: string;
  photos: number;
  videos: number;
  isFolder: boolean;
  isSurvey: boolean;
}

/**
 * What is in a folder; `parent` is "" where one may not go further up.
 */
export interface Listing {
  path: string;
  parent: string;
  photos: number;
  videos: number;
  places: Place[];
}

/**
 * What a person says of a row. Empty texts and None: not said. `photos` are folders (two: sides) or a video.
 *
 * With `metres` "markers", `markers` is a table of their places; with "scale-bar", `scale_bar` has two numbers of
 * markers and the metres between them.
 */
export interface NewSurvey {
  name: string;
  photos: string[];
  oneSide: boolean;
  fruit: string;
  diameterMm: number | null;
  metres: Metres;
  markers: string;
  scaleBar: number[];
  treeSpacingM: number | null;
  learn: boolean;
}

/**
 * The same as a command and as lines of Python.
 */
export interface Equal {
  command: string;
  python: string;
}

/**
 * A side of the row, and how many photos there are of it.
 */
export interface SideView {
  name: string;
  photos: number;
}

/**
 * A photo that may not be of use: "blurred", "dark", "bright", or "gap": too little of the one before is in it.
 */
export interface PhotoProblem {
  photo: string;
  kind: "blurred" | "dark" | "bright" | "gap";
}

/**
 * What was found in photos before a run; `looked_at` of them were opened, all headers were read.
 */
export interface PhotoCheck {
  photos: number;
  lookedAt: number;
  sides: SideView[];
  positions: number;
  focalLengths: number;
  day: string;
  warnings: string[];
  problems: PhotoProblem[];
}

/**
 * A photo of a run, and how many fruits may be in it; None: not looked at yet.
 */
export interface PhotoSoFar {
  name: string;
  found: number | null;
}

/**
 * Cameras, some points and fruits as far as a run has come: x, y, z in metres, z up, one after the other.
 *
 * `colours` are those of the points, red, green and blue in the bytes of a number; `fruits` has a diameter after each
 * place.
 */
export interface SceneSoFar {
  points: number[];
  colours: number[];
  cameras: number[];
  fruits: number[];
}

/**
 * A tree of a survey; None: not known.
 */
export interface TreeRow {
  id: number;
  fruits: number;
  low: number | null;
  high: number | null;
  diameterMm: number | null;
  weightKg: number | null;
}

/**
 * A fruit that a person marked: a box x0, y0, x1, y1, and where a circle was drawn x, y, radius; in pixels.
 */
export interface MarkView {
  box: number[];
  circle: number[] | null;
}

/**
 * A photo to mark fruits in: `marks` so far, whether they are `complete`, and boxes of what was `found` in it.
 *
 * `found` are x0, y0, x1, y1 one after the other.
 */
export interface MarkedView {
  name: string;
  width: number;
  height: number;
  complete: boolean;
  marks: MarkView[];
  found: number[];
}

/**
 * How many fruits are marked in a photo, and whether these are all.
 */
export interface MarkCount {
  photo: string;
  marks: number;
  complete: boolean;
}

/**
 * What a person marked in a photo, in place of what was there.
 */
export interface GivenMarks {
  complete: boolean;
  marks: MarkView[];
}

/**
 * What came of learning, the last time; pairs are before and after. Without `kept` nothing was changed.
 *
 * `f1` is of fruits in photos that were not learnt from, `byHandF1` of the `byHand` fruits in those of them in which
 * all were marked; `halves` is the share of fruits on which two halves of the photos agree. Empty: not known.
 */
export interface LearntView {
  kept: boolean;
  marked: number;
  f1: number[];
  byHand: number;
  byHandF1: number[];
  halves: number[];
  fruits: number[];
  detections: number[];
}

/**
 * What a survey's network learns from, and what it learnt; None: it has not learnt.
 */
export interface Teaching {
  marks: MarkCount[];
  corrections: number;
  learnt: LearntView | null;
  equal: Equal | null;
}

/**
 * Why something was not done, and what to do.
 */
export interface Refusal {
  message: string;
}
