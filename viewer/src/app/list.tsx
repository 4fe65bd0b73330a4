/** The list of surveys. */

import { useState } from "preact/hooks";
import { Chooser } from "./chooser";
import type { Everything, SurveyView } from "./contract";
import { day, duration, number, texts } from "./language";
import { Doing, Problem } from "./parts";
import { tell } from "./server";

export function go(place: string): void {
  location.hash = place;
}

export function fruitsOf(survey: SurveyView): string {
  const t = texts();
  if (survey.fruits === null) return "";
  const kind = t.fruitNames[survey.fruit];
  return kind && survey.fruits !== 1 ? `${number(survey.fruits)} ${kind}` : t.fruits(survey.fruits, number(survey.fruits));
}

/** How far a run is, as a share of its stages; null where none is at work. */
export function share(survey: SurveyView): number | null {
  if (survey.state !== "running" || !survey.run) return null;
  const { stages, done, total } = survey.run;
  const over = stages.filter((stage) => stage.state === "done" || stage.state === "kept").length;
  return (over + (total ? done / total : 0)) / stages.length;
}

function Card({ survey }: { survey: SurveyView }) {
  const t = texts();
  const progress = share(survey);
  const middle = survey.photos ? Math.floor(survey.photos / 4) : 0;
  return (
    <li>
      <a class="card" href={`#/survey/${survey.id}`}>
        <span class="picture">
          {survey.photos ? <img src={`api/surveys/${survey.id}/photos/${middle}/320.jpg?${survey.version}`} alt="" loading="lazy" onError={(event) => (event.currentTarget.hidden = true)} /> : null}
        </span>
        <span class="about">
          <strong>{survey.name}</strong>
          <span class={`state ${survey.state}`}>{t.states[survey.state]}</span>
          {progress !== null && <progress value={progress} max={1} aria-label={t.progress} />}
          {survey.state === "running" && survey.run?.leftS != null && <span class="soft">{t.left(duration(survey.run.leftS))}</span>}
          {survey.fruits !== null && <span class="figure">{fruitsOf(survey)}</span>}
          <span class="soft">
            {[survey.photos === null ? "" : t.photos(survey.photos, number(survey.photos)), survey.day ? t.taken(day(survey.day)) : day(survey.changed)].filter(Boolean).join(" · ")}
          </span>
        </span>
      </a>
    </li>
  );
}

export function List({ everything }: { everything: Everything }) {
  const t = texts();
  const [choosing, setChoosing] = useState(false);
  const [problem, setProblem] = useState("");
  const add = async (folder: string) => {
    setChoosing(false);
    setProblem("");
    try {
      go(`/survey/${await tell<string>("surveys/add", { folder })}`);
    } catch (error) {
      setProblem((error as Error).message);
    }
  };
  const sample = <Doing onDo={async () => go(`/survey/${await tell<string>("surveys/sample")}`)}>{t.trySample}</Doing>;
  return (
    <main>
      <div class="head">
        <h1>{t.surveys}</h1>
        <span class="end">
          <button type="button" onClick={() => setChoosing(true)}>
            {t.openSurvey}
          </button>
          <a class="button main" href="#/new">
            {t.newSurvey}
          </a>
        </span>
      </div>
      {problem && <Problem text={problem} />}
      {everything.surveys.length ? (
        <ul class="cards">
          {everything.surveys.map((survey) => (
            <Card key={survey.id} survey={survey} />
          ))}
        </ul>
      ) : (
        <div class="sheet empty">
          <h2>{t.none}</h2>
          <p>{t.noneText}</p>
          <p class="line">
            <a class="button main" href="#/new">
              {t.newSurvey}
            </a>
            {sample}
            <span class="soft">{t.sampleText}</span>
          </p>
        </div>
      )}
      {choosing && <Chooser title={t.openSurvey} kind="survey" start={everything.facts.surveysFolder} roots={everything.facts.roots} onClose={() => setChoosing(false)} onChoose={add} />}
    </main>
  );
}
