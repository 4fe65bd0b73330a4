/** Small parts that several pages share. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { texts } from "./language";
import { NO_ANSWER } from "./server";

/** Text in which `code` stands in backticks, as Pomona's messages have it. */
export function Said({ text }: { text: string }) {
  return <>{text.split("`").map((part, i) => (i % 2 ? <code key={i}>{part}</code> : part))}</>;
}

export function Problem({ text, title }: { text: string; title?: string }) {
  return (
    <div class="problem" role="alert">
      <strong>{title ?? texts().problem}</strong>
      <p>
        <Said text={text === NO_ANSWER ? texts().noAnswer : text} />
      </p>
    </div>
  );
}

/** A button that does something that takes a while, and says when it does not go. */
export function Doing({ onDo, class: kind, disabled, children }: { onDo: () => Promise<unknown>; class?: string; disabled?: boolean; children: ComponentChildren }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState("");
  const there = useRef(true);
  useEffect(() => () => void (there.current = false), []);
  const run = async () => {
    setBusy(true);
    setProblem("");
    try {
      await onDo();
    } catch (error) {
      if (there.current) setProblem((error as Error).message);
    }
    if (there.current) setBusy(false);
  };
  return (
    <>
      <button type="button" class={kind} disabled={busy || disabled} onClick={run}>
        {children}
      </button>
      {problem && <Problem text={problem} />}
    </>
  );
}

/** A window over the page, closed by Escape; the keyboard goes back to what opened it. */
export function Dialog({ title, onClose, wide, children }: { title: string; onClose: () => void; wide?: boolean; children: ComponentChildren }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const there = useRef(true);
  useEffect(() => {
    const shown = dialog.current!;
    shown.showModal();
    return () => {
      there.current = false;
      shown.close();
    };
  }, []);
  return (
    <dialog ref={dialog} class={wide ? "wide" : undefined} aria-label={title} onClose={() => there.current && onClose()}>
      <div class="bar">
        <h2>{title}</h2>
        <button type="button" class="plain" aria-label={texts().cancel} onClick={onClose}>
          ×
        </button>
      </div>
      {children}
    </dialog>
  );
}

export function Copyable({ text }: { text: string }) {
  const [copied, setCopied] = useState(false);
  const copy = async () => {
    await navigator.clipboard.writeText(text);
    setCopied(true);
  };
  return (
    <div class="copyable">
      <pre tabIndex={0}>{text}</pre>
      <button type="button" onClick={copy}>
        {copied ? texts().copied : texts().copy}
      </button>
    </div>
  );
}
