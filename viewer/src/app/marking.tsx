/** A photo to mark fruits in: two clicks each, with zoom, undo and keys. What is marked is kept at once. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { MarkedView } from "./contract";
import { number, texts } from "./language";
import { between, changed, inside, outlineAt, undone, zoomed, type Marking, type Point, type Shape, type Window } from "./marks";
import { Dialog, Problem } from "./parts";
import { ask, tell } from "./server";

const REACH_PX = 7; // of the screen, around outlines
const STEP_PX = 12; // of the screen: how far an arrow key moves the cross
const DRAG_PX = 4;

export function MarkPhoto({ survey, index, photos, onPhoto, onClose }: { survey: string; index: number; photos: number; onPhoto: (index: number) => void; onClose: () => void }) {
  const t = texts();
  const [photo, setPhoto] = useState<MarkedView | null>(null);
  const [marking, setMarking] = useState<Marking>({ marks: [], complete: false, before: [] });
  const [shape, setShape] = useState<Shape>("circle");
  const [first, setFirst] = useState<Point | null>(null);
  const [cross, setCross] = useState<Point | null>(null);
  const [chosen, setChosen] = useState(-1);
  const [showFound, setShowFound] = useState(true);
  const [view, setView] = useState<Window>([0, 0, 1, 1]);
  const [problem, setProblem] = useState("");
  const svg = useRef<SVGSVGElement>(null);
  const drag = useRef<{ x: number; y: number; view: Window; moved: boolean } | null>(null);
  const keeping = useRef<Promise<unknown>>(Promise.resolve());
  // What was asked last to be kept, and what is.
  const newest = useRef<Marking>(marking);
  const kept = useRef<Marking>(marking);
  const address = `surveys/${survey}/photos/${index}`;
  const shown = useRef(address);
  shown.current = address;

  useEffect(() => {
    let there = true;
    setPhoto(null);
    setFirst(null);
    setChosen(-1);
    setProblem("");
    ask<MarkedView>(`${address}/marks`).then(
      (found) => {
        if (!there) return;
        setPhoto(found);
        newest.current = kept.current = { marks: found.marks, complete: found.complete, before: [] };
        setMarking(kept.current);
        setView([0, 0, found.width, found.height]);
      },
      (error: Error) => there && setProblem(error.message),
    );
    return () => void (there = false);
  }, [address]);

  useEffect(() => {
    // The button that led to another photo was away while that was loaded.
    if (photo && document.activeElement === document.body) svg.current?.focus();
  }, [photo]);

  if (!photo) {
    return (
      <Dialog title={t.mark} onClose={onClose}>
        {problem ? <Problem text={problem} /> : <progress aria-label={t.mark} />}
      </Dialog>
    );
  }
  const size: Point = [photo.width, photo.height];
  const keep = (next: Marking) => {
    setMarking(next);
    setChosen(-1);
    setProblem("");
    newest.current = next;
    const given = { complete: next.complete, marks: next.marks };
    const done = () => {
      if (shown.current === address) kept.current = next;
    };
    const failed = (error: Error) => {
      setProblem(error.message);
      // What is shown is what is kept: the person is told to mark it again.
      if (newest.current === next) setMarking(kept.current);
    };
    // One after the other, so that the last one stays.
    keeping.current = keeping.current.then(() => tell(`${address}/marks`, given)).then(done, failed);
  };
  const place = (event: { clientX: number; clientY: number }): Point => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.current!.getScreenCTM()!.inverse());
    return [at.x, at.y];
  };
  const pixel = () => 1 / (svg.current?.getScreenCTM()?.a || 1);
  const click = (at: Point) => {
    if (first) {
      const mark = between(shape, first, at, size);
      setFirst(null);
      if (mark) keep(changed(marking, [...marking.marks, mark]));
      return;
    }
    const hit = outlineAt(marking.marks, at, REACH_PX * pixel());
    setChosen(hit);
    if (hit < 0) setFirst(at);
  };
  const remove = () => chosen >= 0 && keep(changed(marking, marking.marks.filter((_, i) => i !== chosen)));
  const undo = () => marking.before.length && keep(undone(marking));
  const zoom = (by: number, at: Point = [view[0] + view[2] / 2, view[1] + view[3] / 2]) => setView(zoomed(view, by, at, size));
  const leave = () => void keeping.current.then(onClose);
  const key = (event: KeyboardEvent) => {
    const moves: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const move = moves[event.key];
    const at = cross ?? [view[0] + view[2] / 2, view[1] + view[3] / 2];
    if (move) {
      const by = (event.shiftKey ? 1 : STEP_PX) * pixel();
      setCross([Math.min(Math.max(at[0] + move[0] * by, 0), size[0]), Math.min(Math.max(at[1] + move[1] * by, 0), size[1])]);
    } else if (event.key === "Enter" || event.key === " ") click(at);
    else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1.4 : 1 / 1.4, at);
    else if (event.key === "Delete" || event.key === "Backspace") remove();
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) undo();
    else if (event.key === "Escape" && first) setFirst(null);
    else return;
    event.preventDefault();
  };
  const thin = 1.6 * pixel();
  const started = first && cross ? between(shape, first, cross, size) : null;
  return (
    <Dialog title={t.photoOf(photo.name, t.marksOf(marking.marks.length, number(marking.marks.length)))} onClose={leave} wide>
      <div class="line tools" role="toolbar" aria-label={t.mark}>
        {(["circle", "box"] as const).map((each) => (
          <button key={each} type="button" aria-pressed={shape === each} onClick={() => setShape(each)}>
            {t.shapes[each]}
          </button>
        ))}
        <button type="button" disabled={!marking.before.length} onClick={undo}>
          {t.undo}
        </button>
        <button type="button" disabled={chosen < 0} onClick={remove}>
          {t.deleteMark}
        </button>
        <button type="button" aria-label={t.nearer} onClick={() => zoom(1.5)}>
          +
        </button>
        <button type="button" aria-label={t.farther} onClick={() => zoom(1 / 1.5)}>
          −
        </button>
        <label class="line">
          <input type="checkbox" checked={showFound} onChange={(event) => setShowFound(event.currentTarget.checked)} /> {t.showFound}
        </label>
        <span class="end">
          <button type="button" disabled={index === 0} aria-label={t.photoBefore} onClick={() => onPhoto(index - 1)}>
            ‹
          </button>
          <button type="button" disabled={index === photos - 1} aria-label={t.photoAfter} onClick={() => onPhoto(index + 1)}>
            ›
          </button>
        </span>
      </div>
      {problem && <Problem text={problem} />}
      <svg
        ref={svg}
        class="marking"
        tabindex={0}
        role="application"
        aria-label={t.markLabel}
        viewBox={view.join(" ")}
        onKeyDown={key}
        onWheel={(event) => {
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 400), place(event));
        }}
        onPointerDown={(event) => {
          drag.current = { x: event.clientX, y: event.clientY, view, moved: false };
          event.currentTarget.setPointerCapture(event.pointerId);
        }}
        onPointerMove={(event) => {
          const from = drag.current;
          setCross(place(event));
          if (!from || !event.buttons) return;
          const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
          from.moved ||= Math.hypot(dx, dy) > DRAG_PX;
          if (from.moved) setView(inside([from.view[0] - dx * pixel(), from.view[1] - dy * pixel(), from.view[2], from.view[3]], size));
        }}
        onPointerUp={(event) => {
          if (drag.current && !drag.current.moved) click(place(event));
          drag.current = null;
        }}
      >
        <image href={`api/${address}/whole.jpg`} width={photo.width} height={photo.height} preserveAspectRatio="none" />
        {showFound &&
          Array.from({ length: photo.found.length / 4 }, (_, i) => photo.found.slice(4 * i, 4 * i + 4)).map(([x0, y0, x1, y1], i) => (
            <rect key={`found-${i}`} class="found" x={x0} y={y0} width={x1! - x0!} height={y1! - y0!} stroke-width={thin} />
          ))}
        {[...marking.marks, ...(started ? [started] : [])].map(({ box, circle }, i) => {
          const kind = i === chosen ? "mark on" : i === marking.marks.length ? "mark started" : "mark";
          return circle ? (
            <circle key={i} class={kind} cx={circle[0]} cy={circle[1]} r={circle[2]} stroke-width={1.5 * thin} />
          ) : (
            <rect key={i} class={kind} x={box[0]} y={box[1]} width={box[2]! - box[0]!} height={box[3]! - box[1]!} stroke-width={1.5 * thin} />
          );
        })}
        {cross && <path class="cross" d={`M${cross[0] - 9 * pixel()} ${cross[1]}h${18 * pixel()}M${cross[0]} ${cross[1] - 9 * pixel()}v${18 * pixel()}`} stroke-width={thin} />}
      </svg>
      <p class="line">
        <label class="line">
          <input type="checkbox" checked={marking.complete} onChange={(event) => keep(changed(marking, marking.marks, event.currentTarget.checked))} />
          <span>
            {t.complete} <span class="soft">{t.completeText}</span>
          </span>
        </label>
      </p>
      <p class="soft">{first ? t.markSecond[shape] : t.markFirst[shape]}</p>
    </Dialog>
  );
}
