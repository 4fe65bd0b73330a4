/** What Python tells the viewer. Written by `python -m pomona.stages.report.typescript`; do not edit. */

export type U8 = Uint8Array;
export type U16 = Uint16Array;
export type U32 = Uint32Array;
export type F32 = Float32Array;
export type Source = "report" | "folder" | "server";
export type CorrectionKind = "delete" | "add" | "split" | "merge" | "move" | "undo" | "redo";
export type WatchPhase = "waiting" | "looking" | "finishing" | "finished";

/**
 * `count` points in an order by chance, so that the first of them are an even sample of all: `points` (k, 4).
 *
 * x, y and z divide the box from `min` of extent `size` in 65535 steps; the fourth number is a colour of 5, 6 and 5
 * bits. Where k is less than `count`, a server has the other points in pieces of k, the second one being piece 1.
 */
export interface PackedCloud {
  count: number;
  min: [number, number, number];
  size: [number, number, number];
  points: U16;
}

/**
 * More points of a cloud, (k, 4).
 */
export interface PointPiece {
  points: U16;
}

/**
 * n fruits; NaN where something was not measured, and `reasons` says why. `trees`: 0 for none.
 */
export interface FruitColumns {
  ids: number[];
  centers: F32;
  diameters: F32;
  diameterSds: F32;
  visibilities: F32;
  weights: F32;
  scores: F32;
  views: U32;
  sides: string[];
  trees: number[];
  reasons: string[];
}

/**
 * n photos that have a place. `frusta` (n, 5, 3): the centre, then the corners from the top left, clockwise.
 *
 * `rotations` (n, 3, 3) turn the world's axes into the camera's (x right, y down, z forward); `lenses` (n, 4) are fx,
 * fy, cx, cy in pixels. `files`: where a resized copy lies, in an exported folder ("": none).
 */
export interface PhotoColumns {
  names: string[];
  sides: string[];
  widths: number[];
  heights: number[];
  frusta: F32;
  rotations: F32;
  lenses: F32;
  files: string[];
}

/**
 * k times that a photo saw one of n fruits: the photo's index, the detection's id, the crop around it.
 *
 * Those of fruit i are `starts[i]` to `starts[i + 1]`, the largest first; `starts` has n + 1 entries. `boxes` (k, 4):
 * x, y, width and height of the crop in pixels. Its JPEG is bytes `crop_starts[i]` to `crop_starts[i + 1]` of `crops`
 * (none: not in this file).
 */
export interface Sightings {
  starts: U32;
  photos: U32;
  detections: U32;
  boxes: F32;
  cropStarts: U32;
  crops: U8;
}

/**
 * n detections: ids, the index of the photo, the id of the fruit they became (0: none), and their outlines.
 *
 * Outline i is points `starts[i]` to `starts[i + 1]` of `points` (m, 2), pixels; `starts` has n + 1 entries.
 */
export interface DetectionColumns {
  ids: U32;
  photos: U32;
  fruits: U32;
  scores: F32;
  starts: U32;
  points: F32;
}

/**
 * What photos saw of one fruit, asked for when it is selected.
 */
export interface SeenFruit {
  sightings: Sightings;
  detections: DetectionColumns;
}

/**
 * n trees: their ids and where they stand, on the ground, (n, 3).
 */
export interface TreePlaces {
  ids: number[];
  places: F32;
}

/**
 * Scores of the fruits whose score is at least `threshold`; None (null) where one is undefined.
 */
export interface Rates {
  threshold: number;
  precision: number | null;
  recall: number | null;
  f1: number | null;
  true: number;
  false: number;
  missed: number;
  doubled: number;
}

/**
 * n true fruits, and what becomes of found and true ones at each of k score thresholds.
 *
 * `found` (k, fruits): 0 below the threshold, 1 true, 2 false, 3 doubled, 4 not scored. `missed` (k, n): 1 where no
 * found fruit is the true one. `label` says over which true fruits the scores are: "all" or "visible".
 */
export interface TruthData {
  label: string;
  centers: F32;
  diameters: F32;
  steps: Rates[];
  found: U8;
  missed: U8;
}

/**
 * n fruits of an earlier survey, laid over this one's, and the growth of these (NaN: not known).
 *
 * `later`: the index of the same fruit now, −1 for none. `in_view` (n,): photos of now show the place.
 */
export interface EarlierFruits {
  centers: F32;
  diameters: F32;
  later: number[];
  inView: U8;
  growth: F32;
}

/**
 * Where to look: `toward` is the direction from the fruits to where most photos were taken from (unit, in 3D).
 *
 * `along` and `across` are the row's axes, horizontal and of unit length; `across` points to most of the cameras.
 * `radius` is that of the fruits; `row` the ends of the row's axis; `low` and `high` what there is in height.
 */
export interface ViewHints {
  radius: number;
  toward: [number, number, number];
  along: [number, number, number];
  across: [number, number, number];
  row: [number, number];
  low: number;
  high: number;
  ground: number;
  grid: number;
}

/**
 * What a person changed, in words, the last one last; and what was undone, the next to be redone last.
 *
 * `revision` names this state of the log: a request made from another one is refused. `lost` are corrections that
 * match no fruit. `fruits`: how each fruit was corrected ("": not at all). `usual_diameter` is the size of an added
 * fruit unless it is clicked. `note` says why nothing can be corrected ("": it can).
 */
export interface CorrectionState {
  revision: string;
  done: string[];
  undone: string[];
  lost: string[];
  fruits: string[];
  usualDiameter: number | null;
  note: string;
}

/**
 * A place clicked in a photo: the photo's index, pixels.
 */
export interface PhotoMark {
  photo: number;
  x: number;
  y: number;
}

/**
 * What the page asks the server to change.
 *
 * `fruits` are ids: one to delete, split or move, two to merge. `marks` are the middle of a missed fruit in two or
 * more photos, or the middles of two fruits that were taken for one, in one photo. `size`: none, or two marks on
 * opposite edges of the fruit. `tree`: where to move a fruit to (0: to none).
 */
export interface CorrectionRequest {
  kind: CorrectionKind;
  revision: string;
  fruits: number[];
  marks: PhotoMark[];
  size: PhotoMark[];
  tree: number;
}

/**
 * What was done, or why nothing was, in words; and the id of the fruit to look at then (0: none).
 *
 * `changed`: fruits are not what the page shows any more, so that it has to be loaded again.
 */
export interface CorrectionAnswer {
  changed: boolean;
  message: string;
  fruit: number;
}

/**
 * Where other photos may show what was clicked in one: n photos, the best suited first, and a line in each.
 *
 * `lines[i]` are x and y of each of its points in turn, in pixels.
 */
export interface SightLines {
  photos: number[];
  lines: number[][];
}

/**
 * What is the `matter` with a photo, and in words what to do.
 */
export interface WatchHint {
  photo: string;
  matter: string;
  text: string;
}

/**
 * How far the watch of photos that arrive is. `doing`: in words; the survey's folder where it is finished.
 *
 * `revision` is that of the page with the present answer. `placed` of the `photos` have a place; the others are null
 * where they are not known: `fruits`, the `length` of row in metres, the usual `step`, and `well_seen`, the share of
 * fruits that three photos saw. `hints`: the last ones, the newest first.
 */
export interface WatchState {
  phase: WatchPhase;
  doing: string;
  revision: number;
  photos: number;
  placed: number;
  fruits: number | null;
  length: number | null;
  step: number | null;
  wellSeen: number | null;
  hints: WatchHint[];
}

/**
 * All that the view shows at once. `source` says where photos come from: none in a report, files, or a server.
 *
 * `sightings` and `detections` are null where a server is asked for them, by fruit and by photo. `provisional`: photos
 * still arrive, and the server tells of that. `photos_version` goes into the addresses of a server's photos: browsers
 * keep photos, and another survey may have been at the same address.
 */
export interface SurveyData {
  source: Source;
  provisional: boolean;
  photosNote: string;
  photosVersion: string;
  title: string;
  unit: string;
  metric: boolean;
  origin: [number, number, number];
  scene: PackedCloud;
  fruitPoints: PackedCloud;
  fruits: FruitColumns;
  photos: PhotoColumns;
  sightings: Sightings | null;
  detections: DetectionColumns | null;
  trees: TreePlaces;
  view: ViewHints;
  truth: TruthData | null;
  earlier: EarlierFruits | null;
  corrections: CorrectionState | null;
}
