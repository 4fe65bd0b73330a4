/** One survey: its run, what it has found so far, and its results. */

import { useEffect, useState } from "preact/hooks";
import type { Equal, Everything, PhotoSoFar, SurveyView, TreeRow } from "./contract";
import { day, duration, number, stepOf, texts } from "./language";
import { fruitsOf, go, share } from "./list";
import { Copyable, Dialog, Doing, Problem, Said } from "./parts";
import { Scene } from "./scene";
import { ask, download, tell } from "./server";
import { Teach } from "./teach";

const WORKING = ["queued", "running", "stopping"];
const PHOTOS_AT_FIRST = 24;
const FILES = ["report.html", "fruits.csv", "trees.csv", "gpkg", "fruits.geojson", "kml", "laz", "ply", "coco", "colmap", "nerfstudio", "metashape", "geoparquet"];

function Controls({ survey }: { survey: SurveyView }) {
  const t = texts();
  if (survey.run?.byOther) return <p class="soft">{t.byOther}</p>;
  const act = (what: string) => () => tell(`surveys/${survey.id}/${what}`);
  if (survey.state === "queued") return <Doing onDo={act("stop")}>{t.unqueue}</Doing>;
  if (survey.state === "running") return <Doing onDo={act("stop")}>{t.stop}</Doing>;
  if (survey.state === "stopping") {
    return (
      <span class="line">
        <Doing onDo={act("stop")}>{t.stopNow}</Doing> <span class="soft">{t.stoppingText}</span>
      </span>
    );
  }
  if (survey.state === "missing") return <p class="soft">{t.missingText}</p>;
  const over = survey.state === "finished";
  return (
    <Doing class={over ? "" : "main"} onDo={act("go-on")}>
      {over ? t.again : t.goOn}
    </Doing>
  );
}

function Progress({ survey }: { survey: SurveyView }) {
  const t = texts();
  const run = survey.run;
  if (!run) return null;
  const progress = share(survey);
  const now = run.stages.find((stage) => stage.state === "now");
  const working = WORKING.includes(survey.state);
  return (
    <section class="sheet" aria-label={t.progress}>
      {progress !== null && (
        <div class="now" role="status">
          <span class="line">
            <strong>{now ? t.stages[now.name] ?? now.name : ""}</strong>
            <span class="soft">
              {stepOf(run.label)} {run.total ? t.of(number(run.done), number(run.total)) : ""}
            </span>
            {run.leftS !== null && <span class="end">{t.left(duration(run.leftS))}</span>}
          </span>
          <progress value={progress} max={1} aria-label={t.progress} />
        </div>
      )}
      <ol class="stages">
        {run.stages.map((stage) => (
          <li key={stage.name} class={stage.state} aria-current={stage === now && working ? "step" : undefined}>
            <span class="name">{t.stages[stage.name] ?? stage.name}</span>
            <span class="soft">{stage.seconds === null ? "" : duration(stage.seconds)}</span>
            <span class="hidden">{t.stageStates[stage === now && !working ? "halted" : stage.state]}</span>
          </li>
        ))}
      </ol>
      {run.message && (survey.state === "failed" || survey.state === "stopped") && (
        <>
          <Problem title={t.failed} text={run.message} />
          <p class="soft">{t.failedDo}</p>
        </>
      )}
      {run.warnings.length > 0 && (
        <div class="warnings">
          <h3>{t.warnings}</h3>
          {t.english && <p class="soft">{t.english}</p>}
          <ul>
            {run.warnings.map((warning) => (
              <li key={warning}>
                <Said text={warning} />
              </li>
            ))}
          </ul>
        </div>
      )}
      {run.log.length > 0 && (
        <details>
          <summary>{t.log}</summary>
          <pre class="log" tabIndex={0}>
            {run.log.join("\n")}
          </pre>
        </details>
      )}
    </section>
  );
}

function Photos({ survey }: { survey: SurveyView }) {
  const t = texts();
  const [photos, setPhotos] = useState<PhotoSoFar[]>([]);
  const [shown, setShown] = useState(PHOTOS_AT_FIRST);
  const [large, setLarge] = useState<number | null>(null);
  // While fruits are looked for in photos, each that is done is news.
  const news = survey.run?.stages.some((stage) => stage.name === "segment" && stage.state === "now") ? survey.run.done : 0;
  useEffect(() => void ask<PhotoSoFar[]>(`surveys/${survey.id}/photos`).then(setPhotos, () => setPhotos([])), [survey.id, survey.version, news]);
  if (!photos.length) return <p class="soft">{t.photosWait}</p>;
  const said = (photo: PhotoSoFar) => (photo.found === null ? (survey.fruits === null ? t.notYet : "") : t.possible(photo.found, number(photo.found)));
  const address = (i: number, side: number) => `api/surveys/${survey.id}/photos/${i}/${side}.jpg?${photos[i]!.found ?? ""}-${survey.version}`;
  const at = large === null ? null : photos[large];
  return (
    <>
      <ul class="photos">
        {photos.slice(0, shown).map((photo, i) => (
          <li key={photo.name}>
            <button type="button" onClick={() => setLarge(i)} aria-label={t.photoOf(photo.name, said(photo))}>
              <img src={address(i, 320)} alt="" loading="lazy" />
              <span class="path">{photo.name}</span>
              <span class="soft">{said(photo)}</span>
            </button>
          </li>
        ))}
      </ul>
      {photos.length > shown && (
        <button type="button" onClick={() => setShown(photos.length)}>
          {t.more(number(photos.length - shown))}
        </button>
      )}
      {at && large !== null && (
        <Dialog title={t.photoOf(at.name, said(at))} onClose={() => setLarge(null)}>
          <img class="large" src={address(large, 1280)} alt={t.photoOf(at.name, said(at))} />
        </Dialog>
      )}
    </>
  );
}

function Trees({ survey }: { survey: SurveyView }) {
  const t = texts();
  const [trees, setTrees] = useState<TreeRow[] | null>(null);
  const [problem, setProblem] = useState("");
  useEffect(() => void ask<TreeRow[]>(`surveys/${survey.id}/trees`).then(setTrees, (error: Error) => setProblem(error.message)), [survey.id, survey.version]);
  if (problem) return <Problem text={problem} />;
  if (!trees) return <progress aria-label={t.treesTab} />;
  if (!trees.length) return <p class="soft">{t.noTrees}</p>;
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={t.treesTab}>
      <table>
        <thead>
          <tr>
            {[t.tree, t.fruitsHead, t.between, `${t.diameter} (mm)`, `${t.weight} (kg)`].map((title) => (
              <th key={title} scope="col">
                {title}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {trees.map((tree) => (
            <tr key={tree.id}>
              <th scope="row">{tree.id}</th>
              <td>{number(tree.fruits)}</td>
              <td>{tree.low === null || tree.high === null ? "" : `${number(tree.low)} – ${number(tree.high)}`}</td>
              <td>{tree.diameterMm === null ? "" : number(tree.diameterMm, 1)}</td>
              <td>{tree.weightKg === null ? "" : number(tree.weightKg, 2)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Compare({ survey, everything }: { survey: SurveyView; everything: Everything }) {
  const t = texts();
  const others = everything.surveys.filter((other) => other.id !== survey.id && other.fruits !== null);
  const [before, setBefore] = useState(others[0]?.id ?? "");
  const [page, setPage] = useState("");
  // The page of the same two is at the same address, and may say something else by now.
  const [made, setMade] = useState(0);
  const compare = async () => {
    setPage(await tell<string>(`surveys/${survey.id}/compare`, { before }));
    setMade(made + 1);
  };
  const choose = (other: string) => {
    setBefore(other);
    setPage("");
  };
  if (!others.length) return <p class="soft">{t.compareNone}</p>;
  return (
    <>
      <p class="soft">{t.compareText}</p>
      <p class="line">
        <label class="line">
          {t.compareWith}
          <select value={before} onChange={(event) => choose(event.currentTarget.value)}>
            {others.map((other) => (
              <option key={other.id} value={other.id}>
                {other.name}
              </option>
            ))}
          </select>
        </label>
        <Doing class="main" onDo={compare}>
          {t.compare}
        </Doing>
      </p>
      {page && <iframe class="view" src={page.slice(1)} title={t.compareTab} key={made} />}
    </>
  );
}

function Files({ survey, everything }: { survey: SurveyView; everything: Everything }) {
  const t = texts();
  const known = FILES.filter((name) => name.includes(".") || everything.facts.exports.includes(name));
  return (
    <>
      <h2>{t.files}</h2>
      <ul class="files">
        {known.map((name) => (
          <li key={name}>
            <Doing onDo={() => download(`surveys/${survey.id}/files/${name}`)}>{t.fileNames[name] ?? name}</Doing>
          </li>
        ))}
      </ul>
      <p class="soft path">
        {t.folder}: {survey.folder}
      </p>
    </>
  );
}

function Equals({ survey }: { survey: SurveyView }) {
  const t = texts();
  const [equal, setEqual] = useState<Equal | null>(null);
  const load = () => void ask<Equal>(`surveys/${survey.id}/equal`).then(setEqual, () => setEqual(null));
  return (
    <details class="sheet" onToggle={load}>
      <summary>{t.equal}</summary>
      {equal && (
        <>
          <h3>{t.equalCommand}</h3>
          <Copyable text={equal.command} />
          <h3>{t.equalPython}</h3>
          <Copyable text={equal.python} />
        </>
      )}
    </details>
  );
}

const TABS = ["photos", "scene", "result", "trees", "compare", "teach", "files"] as const;
type Tab = (typeof TABS)[number];

export function Survey({ survey, everything, place }: { survey: SurveyView; everything: Everything; place: string }) {
  const t = texts();
  const over = survey.state === "finished";
  // What an earlier run came to can be looked at, however the last one ended: it says so where it is older than the rest.
  const shown = over || (survey.fruits !== null && ["stopped", "failed"].includes(survey.state));
  const found = TABS.find((each) => each === place);
  const tab: Tab = found ?? (shown ? "result" : survey.fruits !== null || survey.run?.stages.some((stage) => stage.name === "scale" && (stage.state === "done" || stage.state === "kept")) ? "scene" : "photos");
  const titles: Record<Tab, string> = { photos: t.photosTab, scene: t.sceneTab, result: t.resultTab, trees: t.treesTab, compare: t.compareTab, teach: t.teachTab, files: t.exportTab };
  const panel = () => {
    if (tab === "photos") return <Photos survey={survey} />;
    if (tab === "scene") return <Scene survey={survey} />;
    if (tab === "teach") return <Teach survey={survey} canLearn={everything.facts.canLearn} working={WORKING.includes(survey.state) || !!survey.run?.byOther} />;
    if (!shown) return <p class="soft">{t.resultWait}</p>;
    if (tab === "trees") return <Trees survey={survey} />;
    if (tab === "compare") return <Compare survey={survey} everything={everything} />;
    if (tab === "files") return <Files survey={survey} everything={everything} />;
    return (
      <>
        <p class="line">
          <button type="button" class="end" onClick={() => document.querySelector<HTMLIFrameElement>("iframe.view")?.contentWindow?.print()}>
            {t.print}
          </button>
        </p>
        <iframe class="view" src={`surveys/${survey.id}/view/`} title={t.viewTitle} key={survey.id} />
      </>
    );
  };
  return (
    <main>
      <div class="head">
        <a class="button plain" href="#/" aria-label={t.back}>
          ‹
        </a>
        <h1>{survey.name}</h1>
        <span class={`state ${survey.state}`}>{t.states[survey.state]}</span>
        <span class="end">
          <Controls survey={survey} />
        </span>
      </div>
      <p class="soft">
        {[
          fruitsOf(survey),
          survey.weightKg === null ? "" : `${number(survey.weightKg, 1)} kg`,
          survey.corrected ? t.corrected : "",
          survey.photos === null ? "" : t.photos(survey.photos, number(survey.photos)),
          survey.day ? t.taken(day(survey.day)) : "",
        ]
          .filter(Boolean)
          .join(" · ")}
      </p>
      {!over && <Progress survey={survey} />}
      <section class="sheet results">
        <div class="tabs" role="tablist">
          {TABS.map((each) => (
            <a
              key={each}
              role="tab"
              id={`tab-${each}`}
              aria-selected={tab === each}
              aria-controls="panel"
              href={`#/survey/${survey.id}/${each}`}
              tabIndex={tab === each ? 0 : -1}
              onKeyDown={(event) => {
                const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
                if (!step) return;
                const next = TABS[(TABS.indexOf(each) + step + TABS.length) % TABS.length]!;
                go(`/survey/${survey.id}/${next}`);
                document.getElementById(`tab-${next}`)?.focus();
              }}
            >
              {titles[each]}
            </a>
          ))}
        </div>
        <div id="panel" role="tabpanel" aria-labelledby={`tab-${tab}`}>
          {panel()}
        </div>
      </section>
      {over && <Progress survey={survey} />}
      {survey.photos !== null && <Equals survey={survey} />}
      {!WORKING.includes(survey.state) && (
        <p class="line">
          <Doing
            onDo={async () => {
              await tell(`surveys/${survey.id}/forget`);
              go("/");
            }}
          >
            {t.forget}
          </Doing>
          <span class="soft">{t.forgetText}</span>
        </p>
      )}
    </main>
  );
}
