/** The row so far: points, camera places and fruits, turned by hand. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { SceneSoFar, SurveyView } from "./contract";
import { number, texts } from "./language";
import { ask } from "./server";

interface Eye {
  turn: number;
  tilt: number;
  zoom: number;
}

/** The middle of the cameras, and how far they are from it: what lies behind the row does not make it small. */
function middle(cameras: number[]): [number[], number] {
  const count = cameras.length / 3;
  const center = [0, 1, 2].map((axis) => {
    let sum = 0;
    for (let i = axis; i < cameras.length; i += 3) sum += cameras[i]!;
    return sum / count;
  });
  let far = 0;
  for (let i = 0; i < cameras.length; i += 3) far = Math.max(far, Math.hypot(cameras[i]! - center[0]!, cameras[i + 1]! - center[1]!, cameras[i + 2]! - center[2]!));
  return [center, far || 1];
}

function draw(canvas: HTMLCanvasElement, scene: SceneSoFar, eye: Eye): void {
  const box = canvas.getBoundingClientRect();
  const dots = window.devicePixelRatio || 1;
  canvas.width = Math.round(box.width * dots);
  canvas.height = Math.round(box.height * dots);
  const pen = canvas.getContext("2d");
  if (!pen || !box.width) return;
  const [center, far] = middle(scene.cameras);
  const scale = (0.42 * eye.zoom * Math.min(box.width, 1.5 * box.height) * dots) / far;
  const [ct, st, cp, sp] = [Math.cos(eye.turn), Math.sin(eye.turn), Math.cos(eye.tilt), Math.sin(eye.tilt)];
  const place = (values: number[], i: number): [number, number] => {
    const [x, y, z] = [values[i]! - center[0]!, values[i + 1]! - center[1]!, values[i + 2]! - center[2]!];
    return [canvas.width / 2 + (ct * x + st * y) * scale, canvas.height / 2 - (sp * (ct * y - st * x) + cp * z) * scale];
  };
  const colour = (name: string) => {
    canvas.style.color = `var(--${name})`;
    return getComputedStyle(canvas).color;
  };
  for (let i = 0; i < scene.points.length; i += 3) {
    const [x, y] = place(scene.points, i);
    pen.fillStyle = `#${scene.colours[i / 3]!.toString(16).padStart(6, "0")}`;
    pen.fillRect(x, y, 1.8 * dots, 1.8 * dots);
  }
  pen.fillStyle = colour("fruit");
  for (let i = 0; i < scene.fruits.length; i += 4) {
    const [x, y] = place(scene.fruits, i);
    pen.beginPath();
    pen.arc(x, y, Math.max(2.2 * dots, (scene.fruits[i + 3]! / 2) * scale), 0, 7);
    pen.fill();
  }
  pen.fillStyle = colour("camera");
  for (let i = 0; i < scene.cameras.length; i += 3) {
    const [x, y] = place(scene.cameras, i);
    pen.fillRect(x - 3 * dots, y - 2 * dots, 6 * dots, 4 * dots);
  }
}

export function Scene({ survey }: { survey: SurveyView }) {
  const t = texts();
  const [scene, setScene] = useState<SceneSoFar | null>(null);
  const eye = useRef<Eye>({ turn: 0, tilt: 0.35, zoom: 1 });
  const canvas = useRef<HTMLCanvasElement>(null);
  const render = () => canvas.current && scene && draw(canvas.current, scene, eye.current);
  useEffect(() => void ask<SceneSoFar>(`surveys/${survey.id}/scene`).then(setScene, () => setScene(null)), [survey.id, survey.version]);
  useEffect(() => {
    render();
    const watcher = new ResizeObserver(render);
    if (canvas.current) watcher.observe(canvas.current);
    return () => watcher.disconnect();
  }, [scene]);
  if (!scene || !scene.cameras.length) return <p class="soft">{t.sceneWait}</p>;
  const turn = (across: number, up: number) => {
    eye.current = { ...eye.current, turn: eye.current.turn + across, tilt: Math.min(1.57, Math.max(0, eye.current.tilt + up)) };
    render();
  };
  const zoom = (by: number) => {
    eye.current = { ...eye.current, zoom: Math.min(20, Math.max(0.2, eye.current.zoom * by)) };
    render();
  };
  const keys: Record<string, [number, number]> = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  return (
    <figure>
      <canvas
        ref={canvas}
        class="scene"
        tabIndex={0}
        role="img"
        aria-label={t.sceneLabel}
        onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
        onPointerMove={(event) => event.buttons && turn(event.movementX / 150, event.movementY / 150)}
        onWheel={(event) => {
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 500));
        }}
        onKeyDown={(event) => {
          if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1.2 : 1 / 1.2);
          const by = keys[event.key];
          if (by) {
            event.preventDefault();
            turn(...by);
          }
        }}
      />
      <figcaption class="soft">{t.sceneText(number(scene.cameras.length / 3), number(scene.fruits.length / 4))}</figcaption>
    </figure>
  );
}
