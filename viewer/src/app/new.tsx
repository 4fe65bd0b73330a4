/** A new survey: photos, what is known of the row, a name. */

import { useEffect, useRef, useState } from "preact/hooks";
import { Chooser } from "./chooser";
import type { Equal, Facts, Metres, NewSurvey, PhotoCheck } from "./contract";
import { copy, isFit, ofDrop, ofInput, withFitNames, withoutCommon, type Dropped } from "./dropping";
import { day, number, texts } from "./language";
import { go } from "./list";
import { folderName } from "./names";
import { numberIn } from "./numbers";
import { Copyable, Problem, Said } from "./parts";
import { tell } from "./server";

const METRES: Metres[] = ["gnss", "markers", "scale-bar", "nothing"];

function lastOf(path: string): string {
  return path.split(/[/\\]/).filter(Boolean).pop() ?? path;
}

/** What was found in the photos, and what to do about it. */
function Check({ check }: { check: PhotoCheck }) {
  const t = texts();
  const kinds = ["gap", "blurred", "dark", "bright"] as const;
  const lines = [
    check.photos ? t.photos(check.photos, number(check.photos)) + (check.day ? `, ${t.taken(day(check.day))}` : "") : t.checkVideo,
    check.photos && check.sides.length > 1 ? t.checkSides(check.sides.map((side) => `${side.name} (${number(side.photos)})`).join(", ")) : "",
    check.photos ? (check.positions ? t.checkPositions(number(check.positions)) : t.checkNoPositions) : "",
    check.lookedAt < check.photos ? t.checkOf(number(check.lookedAt), number(check.photos)) : "",
  ];
  const good = check.photos > 0 && !check.problems.length && !check.warnings.length;
  return (
    <div class="check" role="status">
      {good && <p class="good">✓ {t.checkGood}</p>}
      <p class="soft">{lines.filter(Boolean).join(" · ")}</p>
      {kinds.map((kind) => {
        const names = check.problems.filter((problem) => problem.kind === kind).map((problem) => problem.photo);
        return (
          names.length > 0 && (
            <div class="warning" key={kind}>
              <strong>
                {t.problems[kind]}: {t.photos(names.length, number(names.length))}
              </strong>
              <p>{t.problemDo[kind]}</p>
              <p class="soft names">{names.slice(0, 12).join(", ") + (names.length > 12 ? " …" : "")}</p>
            </div>
          )
        );
      })}
      {check.warnings.map((warning) => (
        <p class="warning" key={warning}>
          <Said text={warning} />
        </p>
      ))}
    </div>
  );
}

function MarkerPicture({ kind }: { kind: Metres }) {
  const t = texts();
  const marks = kind === "markers" ? [30, 95, 160] : kind === "scale-bar" ? [70, 120] : [];
  return (
    <svg class="picture-of" viewBox="0 0 190 70" role="img" aria-label={marks.length ? t.markersPicture : t.metresKinds[kind]}>
      <path d="M0 62H190" class="ground" />
      {[20, 62, 104, 146].map((x) => (
        <g key={x}>
          <path d={`M${x + 12} 62V34`} class="trunk" />
          <circle cx={x + 12} cy="24" r="17" class="crown" />
          <circle cx={x + 6} cy="20" r="3" class="apple" />
          <circle cx={x + 17} cy="27" r="3" class="apple" />
        </g>
      ))}
      {marks.map((x) => (
        <g key={x}>
          <rect x={x - 6} y="44" width="12" height="12" class="marker" />
          <path d={`M${x - 3} 47h4v4h-4zM${x + 1} 51h3v3h-3z`} class="code" />
          <path d={`M${x} 56V62`} class="trunk" />
        </g>
      ))}
      {kind === "scale-bar" && <path d="M76 50H114" class="bar" />}
      {kind === "gnss" && <path d="M150 8l8 4-8 4zM158 12h14" class="bar" />}
    </svg>
  );
}

export function New({ facts }: { facts: Facts }) {
  const t = texts();
  const [photos, setPhotos] = useState<string[]>([]);
  const [choosing, setChoosing] = useState<"photos" | "table" | "">("");
  const [copying, setCopying] = useState<{ done: number; files: number; bytes: number; all: number } | null>(null);
  const [left, setLeft] = useState(0);
  const [renamed, setRenamed] = useState<Dropped[]>([]);
  const [over, setOver] = useState(false);
  const [check, setCheck] = useState<PhotoCheck | null>(null);
  const [checking, setChecking] = useState(false);
  const [problem, setProblem] = useState("");
  const [oneSide, setOneSide] = useState(false);
  const [fruit, setFruit] = useState("");
  const [diameter, setDiameter] = useState("");
  const [metres, setMetres] = useState<Metres>("gnss");
  const [markers, setMarkers] = useState("");
  const [bar, setBar] = useState(["0", "1", ""]);
  const [spacing, setSpacing] = useState("");
  const [learn, setLearn] = useState(false);
  const [name, setName] = useState("");
  const [equal, setEqual] = useState<Equal | null>(null);
  const [refused, setRefused] = useState("");
  const picker = useRef<HTMLInputElement>(null);
  const copied = useRef<Promise<void>>(Promise.resolve());

  // What is typed into a field that is shown; what is no number would be asked for as if nothing had been typed.
  const size = numberIn(diameter, "mm");
  const apart = numberIn(spacing, "m");
  const ends = metres === "scale-bar" ? bar.map((text, i) => numberIn(text, i === 2 ? "m" : "")) : [];
  const unclear = [diameter, spacing, ...bar].filter((_, i) => Number.isNaN([size, apart, ...ends][i]));

  const asked: NewSurvey = {
    name: name.trim(),
    photos,
    oneSide,
    fruit,
    diameterMm: size,
    metres,
    markers: metres === "markers" ? markers : "",
    scaleBar: ends.filter((end) => end !== null),
    treeSpacingM: apart,
    learn,
  };

  useEffect(() => {
    if (!photos.length) {
      setCheck(null);
      return;
    }
    let there = true;
    setChecking(true);
    setProblem("");
    tell<PhotoCheck>("check", { photos, oneSide })
      .then((found) => there && setCheck(found))
      .catch((error: Error) => {
        if (!there) return;
        setCheck(null);
        setProblem(error.message);
      })
      .finally(() => there && setChecking(false));
    return () => void (there = false);
  }, [photos.join("\n"), oneSide]);

  useEffect(() => {
    setEqual(null);
    setRefused("");
    if (!photos.length || !asked.name || unclear.length) return;
    const soon = setTimeout(() => {
      tell<Equal>("equal", asked).then(setEqual, (error: Error) => setRefused(error.message));
    }, 300);
    return () => clearTimeout(soon);
  }, [JSON.stringify(asked), unclear.join("\n")]);

  // Where the photos of one side are chosen, the next ones are those of the other.
  const addPhotos = (path: string) => setPhotos((had) => (had.length === 1 && had[0] !== path ? [...had, path] : [path]));
  const take = (path: string) => {
    setChoosing("");
    if (choosing === "table") {
      setMarkers(path);
      return;
    }
    addPhotos(path);
    if (!name) setName(lastOf(path).replace(/\.[^.]+$/, ""));
  };
  const copyOver = async (fit: Dropped[]) => {
    setProblem("");
    setCopying({ done: 0, files: fit.length, bytes: 0, all: 1 });
    try {
      addPhotos(await copy(fit, (done, bytes, all) => setCopying({ done, files: fit.length, bytes, all })));
    } catch (error) {
      setProblem((error as Error).message);
    }
    setCopying(null);
  };
  const dropped = (files: Dropped[]) => {
    const chosen = withoutCommon(files.filter((each) => isFit(each.name)));
    const fit = withFitNames(chosen);
    setLeft(files.length - fit.length);
    setRenamed(fit.filter(({ name }, i) => name !== chosen[i]!.name));
    // What is dropped while others are copied waits for these.
    if (fit.length) copied.current = copied.current.then(() => copyOver(fit));
  };
  const choseFiles = ({ currentTarget: input }: { currentTarget: HTMLInputElement }) => {
    dropped(ofInput(input.files!));
    // Browsers do not tell that the same files are chosen again, as after a disk was full.
    input.value = "";
  };
  const start = async () => {
    setRefused("");
    try {
      go(`/survey/${await tell<string>("surveys", asked)}`);
    } catch (error) {
      setRefused((error as Error).message);
    }
  };
  const usual = facts.fruits.find((kind) => kind.name === fruit)?.diameterMm ?? facts.fruits[0]!.diameterMm;

  return (
    <main>
      <div class="head">
        <h1>{t.newSurvey}</h1>
      </div>
      <section class="sheet" aria-labelledby="step-photos">
        <h2 id="step-photos">1. {t.step1}</h2>
        <div
          class={`drop ${over ? "over" : ""}`}
          onDragOver={(event) => {
            event.preventDefault();
            setOver(true);
          }}
          onDragLeave={() => setOver(false)}
          onDrop={(event) => {
            event.preventDefault();
            setOver(false);
            if (event.dataTransfer) void ofDrop(event.dataTransfer).then(dropped, (error: Error) => setProblem(error.message));
          }}
        >
          <p class="line">
            <button type="button" class="main" onClick={() => setChoosing("photos")}>
              {photos.length === 1 ? t.secondSide : t.chooseFolder}
            </button>
            <span class="soft">{t.chooseText}</span>
          </p>
          <p class="line">
            <button type="button" onClick={() => picker.current?.click()}>
              {t.chooseFiles}
            </button>
            <span class="soft">
              {t.dropHere}. {t.dropText}
            </span>
            <input ref={picker} type="file" multiple hidden aria-label={t.chooseFiles} onChange={choseFiles} />
          </p>
        </div>
        {copying && (
          <p role="status">
            <progress value={copying.bytes} max={copying.all} aria-label={t.copying(number(copying.done), number(copying.files))} /> {t.copying(number(copying.done), number(copying.files))}
          </p>
        )}
        {left > 0 && <p class="soft">{t.skipped(left)}</p>}
        {renamed.length > 0 && <p class="soft">{t.renamed(renamed.length, renamed[0]!.file.name, renamed[0]!.name)}</p>}
        {photos.length > 0 && (
          <ul class="chosen" aria-label={t.chosen}>
            {photos.map((path) => (
              <li key={path}>
                <span class="path">{path}</span>
                <button type="button" aria-label={`${t.remove}: ${path}`} onClick={() => setPhotos(photos.filter((each) => each !== path))}>
                  {t.remove}
                </button>
              </li>
            ))}
          </ul>
        )}
        {checking && (
          <p role="status">
            <progress aria-label={t.checking} /> {t.checking}
          </p>
        )}
        {problem && <Problem text={problem} />}
        {check && !checking && <Check check={check} />}
      </section>

      <section class="sheet" aria-labelledby="step-known">
        <h2 id="step-known">2. {t.step2}</h2>
        <div class="fields">
          <label>
            {t.fruit}
            <select value={fruit} onChange={(event) => setFruit(event.currentTarget.value)}>
              <option value="">{t.fruitOther}</option>
              {facts.fruits.map((kind) => (
                <option key={kind.name} value={kind.name}>
                  {t.fruitNames[kind.name] ?? kind.name}
                </option>
              ))}
            </select>
            <span class="soft">{t.fruitText}</span>
          </label>
          <label>
            {t.size}
            <input inputMode="decimal" value={diameter} placeholder={number(usual)} onInput={(event) => setDiameter(event.currentTarget.value)} />
            <span class="soft">{t.sizeText(number(usual))}</span>
          </label>
          <label>
            {t.sides}
            <select value={oneSide ? "one" : "auto"} onChange={(event) => setOneSide(event.currentTarget.value === "one")}>
              <option value="auto">{t.sidesAuto}</option>
              <option value="one">{t.sidesOne}</option>
            </select>
          </label>
          <label>
            {t.spacing}
            <input inputMode="decimal" value={spacing} onInput={(event) => setSpacing(event.currentTarget.value)} />
            <span class="soft">{t.spacingText}</span>
          </label>
        </div>
        <fieldset>
          <legend>{t.metres}</legend>
          <div class="kinds">
            {METRES.map((kind) => (
              <label key={kind} class={`kind ${metres === kind ? "on" : ""}`}>
                <span class="line">
                  <input type="radio" name="metres" checked={metres === kind} onChange={() => setMetres(kind)} />
                  <strong>{t.metresKinds[kind]}</strong>
                </span>
                <MarkerPicture kind={kind} />
                <span class="soft">{t.metresText[kind]}</span>
              </label>
            ))}
          </div>
          {metres === "markers" && (
            <p class="line">
              <button type="button" onClick={() => setChoosing("table")}>
                {t.markersFile}…
              </button>
              <span class="path">{markers}</span>
            </p>
          )}
          {metres === "scale-bar" && (
            <div class="fields">
              {[t.barOne, t.barOther, t.barLength].map((title, i) => (
                <label key={title}>
                  {title}
                  <input inputMode="decimal" value={bar[i]} onInput={(event) => setBar(bar.map((text, k) => (k === i ? event.currentTarget.value : text)))} />
                </label>
              ))}
            </div>
          )}
        </fieldset>
        {facts.canLearn && (
          <label class="line">
            <input type="checkbox" checked={learn} onChange={(event) => setLearn(event.currentTarget.checked)} />
            <span>
              {t.learnToo} <span class="soft">{t.learnTooText}</span>
            </span>
          </label>
        )}
      </section>

      <section class="sheet" aria-labelledby="step-start">
        <h2 id="step-start">3. {t.step3}</h2>
        <div class="fields">
          <label>
            {t.name}
            <input value={name} placeholder={t.namePlaceholder} maxLength={100} onInput={(event) => setName(event.currentTarget.value)} />
            <span class="soft path">{t.nameText(`${facts.surveysFolder}/${folderName(name)}`)}</span>
          </label>
        </div>
        {unclear.map((text) => (
          <Problem key={text} text={t.noNumber(text)} />
        ))}
        {refused && <Problem text={refused} />}
        <p class="line">
          <button type="button" class="main" disabled={!photos.length || !name.trim() || copying !== null || unclear.length > 0} onClick={start}>
            {t.start}
          </button>
          <a class="button" href="#/">
            {t.cancel}
          </a>
        </p>
        {equal && (
          <details>
            <summary>{t.equal}</summary>
            <h3>{t.equalCommand}</h3>
            <Copyable text={equal.command} />
            <h3>{t.equalPython}</h3>
            <Copyable text={equal.python} />
          </details>
        )}
      </section>
      {choosing && (
        <Chooser title={choosing === "photos" ? t.chooseFolder : t.markersFile} kind={choosing} start={photos[0]?.replace(/[/\\][^/\\]*$/, "") || facts.home} roots={facts.roots} onClose={() => setChoosing("")} onChoose={take} />
      )}
    </main>
  );
}
