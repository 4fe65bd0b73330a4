/** Teaching a survey's network: fruits marked in photos, learning from them, and what came of it. */

import { useEffect, useState } from "preact/hooks";
import type { LearntView, PhotoSoFar, SurveyView, Teaching } from "./contract";
import { number, texts } from "./language";
import { MarkPhoto } from "./marking";
import { Copyable, Doing, Problem } from "./parts";
import { ask, tell } from "./server";

const PHOTOS_AT_FIRST = 24;

function BeforeAfter({ survey, learnt, photos }: { survey: SurveyView; learnt: LearntView; photos: PhotoSoFar[] }) {
  const t = texts();
  const [shown, setShown] = useState(Math.floor(photos.length / 4));
  const share = (value: number) => number(100 * value) + " %";
  const rows: [string, number[], (value: number) => string][] = [
    [t.learntRows.f1, learnt.f1, (value) => number(value, 3)],
    [t.learntRows.byHand(number(learnt.byHand)), learnt.byHandF1, (value) => number(value, 3)],
    [t.learntRows.halves, learnt.halves, share],
    [t.learntRows.detections, learnt.detections, (value) => number(value)],
    [t.learntRows.fruits, learnt.fruits, (value) => number(value)],
  ];
  const name = photos[shown]?.name ?? "";
  const picture = (which: "before" | "photos") => `api/surveys/${survey.id}/${which}/${shown}/1280.jpg?${survey.version}`;
  return (
    <section class="learnt" aria-label={t.learntTitle}>
      <h3>{t.learntTitle}</h3>
      <p>{learnt.kept ? t.learnt : t.learntNot}</p>
      <table>
        <thead>
          <tr>
            <td />
            <th scope="col">{t.before}</th>
            <th scope="col">{t.after}</th>
          </tr>
        </thead>
        <tbody>
          {rows
            .filter(([, pair]) => pair.length === 2)
            .map(([title, pair, said]) => (
              <tr key={title}>
                <th scope="row">{title}</th>
                <td>{said(pair[0]!)}</td>
                <td>{said(pair[1]!)}</td>
              </tr>
            ))}
        </tbody>
      </table>
      <p class="soft">{t.learntHonest}</p>
      {learnt.kept && photos.length > 0 && (
        <>
          <label class="line">
            {t.photosTab}
            <select value={shown} onChange={(event) => setShown(Number(event.currentTarget.value))}>
              {photos.map((photo, i) => (
                <option key={photo.name} value={i}>
                  {photo.name}
                </option>
              ))}
            </select>
          </label>
          <div class="pair">
            {(["before", "photos"] as const).map((which) => (
              <figure key={which}>
                <img src={picture(which)} alt={`${name}, ${which === "before" ? t.before : t.after}`} loading="lazy" />
                <figcaption class="soft">{which === "before" ? t.before : t.after}</figcaption>
              </figure>
            ))}
          </div>
        </>
      )}
    </section>
  );
}

export function Teach({ survey, canLearn, working }: { survey: SurveyView; canLearn: boolean; working: boolean }) {
  const t = texts();
  const [photos, setPhotos] = useState<PhotoSoFar[]>([]);
  const [teaching, setTeaching] = useState<Teaching | null>(null);
  const [problem, setProblem] = useState("");
  const [shown, setShown] = useState(PHOTOS_AT_FIRST);
  const [marking, setMarking] = useState<number | null>(null);
  useEffect(() => void ask<PhotoSoFar[]>(`surveys/${survey.id}/photos`).then(setPhotos, () => setPhotos([])), [survey.id, survey.version]);
  useEffect(() => {
    if (marking === null) void ask<Teaching>(`surveys/${survey.id}/teaching`).then(setTeaching, (error: Error) => setProblem(error.message));
    // What was learnt and not kept changes nothing of the survey: that learning has ended is the sign.
  }, [survey.id, survey.version, working, marking === null]);
  if (!photos.length) return <p class="soft">{t.photosWait}</p>;
  const marks = new Map(teaching?.marks.map((each) => [each.photo, each]));
  const all = [...marks.values()].reduce((sum, each) => sum + each.marks, 0);
  const complete = [...marks.values()].filter((each) => each.complete).length;
  const said = (name: string) => {
    const mark = marks.get(name);
    return mark ? `${t.marksOf(mark.marks, number(mark.marks))}${mark.complete ? ` · ${t.allMarked}` : ""}` : "";
  };
  // Photos with marks come first: there one goes on.
  const order = photos.map((photo, i) => [photo, i] as const).sort((a, b) => Number(marks.has(b[0].name)) - Number(marks.has(a[0].name)));
  return (
    <>
      <p>{t.teachText}</p>
      {problem && <Problem text={problem} />}
      {teaching?.learnt && <BeforeAfter survey={survey} learnt={teaching.learnt} photos={photos} />}
      <h3>{t.mark}</h3>
      <p class="soft">{t.teachHow}</p>
      <ul class="photos">
        {order.slice(0, shown).map(([photo, i]) => (
          <li key={photo.name}>
            <button type="button" class={marks.has(photo.name) ? "marked" : ""} onClick={() => setMarking(i)} aria-label={`${t.mark}: ${photo.name} ${said(photo.name)}`}>
              <img src={`api/surveys/${survey.id}/photos/${i}/320.jpg?${photo.found ?? ""}-${survey.version}`} alt="" loading="lazy" />
              <span class="path">{photo.name}</span>
              <span class="soft">{said(photo.name)}</span>
            </button>
          </li>
        ))}
      </ul>
      {photos.length > shown && (
        <button type="button" onClick={() => setShown(photos.length)}>
          {t.more(number(photos.length - shown))}
        </button>
      )}
      <h3>{t.learn}</h3>
      <p role="status">{t.taught(t.marksOf(all, number(all)), t.photos(marks.size, number(marks.size)), number(complete), number(teaching?.corrections ?? 0))}</p>
      <p class="soft">{t.learnText}</p>
      {canLearn ? (
        <Doing class="main" disabled={working} onDo={() => tell(`surveys/${survey.id}/learn`)}>
          {t.learnFromThese}
        </Doing>
      ) : (
        <p class="warning">{t.learnMissing}</p>
      )}
      {teaching?.equal && (
        <details>
          <summary>{t.equal}</summary>
          <h3>{t.equalCommand}</h3>
          <Copyable text={teaching.equal.command} />
          <h3>{t.equalPython}</h3>
          <Copyable text={teaching.equal.python} />
        </details>
      )}
      {marking !== null && <MarkPhoto survey={survey.id} index={marking} photos={photos.length} onPhoto={setMarking} onClose={() => setMarking(null)} />}
    </>
  );
}
