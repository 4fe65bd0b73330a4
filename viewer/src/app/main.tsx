/** The page of `pomona app`: a list of surveys, a new one, one of them. */

import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import "./app.css";
import type { Everything } from "./contract";
import { chooseLanguage, current, texts } from "./language";
import { List } from "./list";
import { New } from "./new";
import { Dialog, Doing } from "./parts";
import { listen, tell, type Answers } from "./server";
import { Survey } from "./survey";
import { LANGUAGES } from "./texts";

function switchLight(): void {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
}

function App() {
  const [everything, setEverything] = useState<Everything | null>(null);
  const [answers, setAnswers] = useState<Answers>("yes");
  const [place, setPlace] = useState(location.hash);
  const [language, setLanguage] = useState(current());
  const [closing, setClosing] = useState(false);
  const [closed, setClosed] = useState(false);
  useEffect(() => (closed ? undefined : listen(setEverything, setAnswers)), [closed]);
  useEffect(() => {
    const move = () => setPlace(location.hash);
    addEventListener("hashchange", move);
    return () => removeEventListener("hashchange", move);
  }, []);
  useEffect(() => {
    document.documentElement.lang = language;
  }, [language]);
  const t = texts();
  if (closed) {
    return (
      <main class="closed">
        <h1>{t.closed}</h1>
        <p>{t.closedHow}</p>
      </main>
    );
  }
  const [, kind, id, tab] = place.replace(/^#/, "").split("/");
  const survey = everything?.surveys.find((each) => each.id === id);
  document.title = survey ? `${survey.name} · ${t.title}` : t.title;
  const page = () => {
    if (!everything) return <main><progress aria-label={t.surveys} /></main>;
    if (kind === "new") return <New facts={everything.facts} />;
    if (kind === "survey" && survey) return <Survey key={survey.id} survey={survey} everything={everything} place={tab ?? ""} />;
    return <List everything={everything} />;
  };
  return (
    <>
      <header class="top">
        <a href="#/" class="brand">
          <svg viewBox="0 0 16 16" aria-hidden="true">
            <circle cx="8" cy="9" r="6" fill="#b8322a" />
            <path d="M8 4q0-3 3-3" fill="none" stroke="#4f7d5a" stroke-width="1.6" />
          </svg>
          {t.title}
        </a>
        <span class="end">
          <select
            aria-label="Language, Sprache"
            value={language}
            onChange={(event) => {
              chooseLanguage(event.currentTarget.value);
              setLanguage(event.currentTarget.value);
            }}
          >
            {Object.entries(LANGUAGES).map(([code, each]) => (
              <option key={code} value={code}>
                {each.language}
              </option>
            ))}
          </select>
          <button type="button" aria-label={t.theme} title={t.theme} onClick={switchLight}>
            <svg viewBox="0 0 16 16" aria-hidden="true">
              <path d="M8 2a6 6 0 1 0 0 12z" fill="currentColor" />
              <circle cx="8" cy="8" r="6" fill="none" stroke="currentColor" />
            </svg>
          </button>
          <button type="button" onClick={() => setClosing(true)}>
            {t.close}
          </button>
        </span>
      </header>
      {answers !== "yes" && (
        <p class="lost" role="alert">
          {answers === "no" ? t.lost : t.ended}
        </p>
      )}
      {page()}
      {closing && (
        <Dialog title={t.close} onClose={() => setClosing(false)}>
          <p>{t.closeSure}</p>
          <p class="line">
            <Doing
              class="main"
              onDo={async () => {
                await tell("close");
                setClosed(true);
              }}
            >
              {t.close}
            </Doing>
            <button type="button" onClick={() => setClosing(false)}>
              {t.cancel}
            </button>
          </p>
        </Dialog>
      )}
    </>
  );
}

render(<App />, document.getElementById("app")!);
