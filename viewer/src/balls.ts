/** Fruits as spheres, or, of many fruits, as discs that look like spheres. */

import * as three from "three";
import type { Rgb } from "./colours";
import type { Fruit } from "./payload";

export interface FruitDrawing {
  readonly object: three.Object3D;
  /** Radii in the world; 0 hides a fruit. */
  size(radii: Float32Array): void;
  colour(colours: Rgb[]): void;
  seeThrough(opacity: number): void;
}

export class FruitSpheres implements FruitDrawing {
  readonly object: three.InstancedMesh;

  constructor(private readonly fruits: Fruit[]) {
    this.object = new three.InstancedMesh(new three.SphereGeometry(1, 24, 16), new three.MeshStandardMaterial({ roughness: 0.55 }), fruits.length);
  }

  size(radii: Float32Array): void {
    const matrix = new three.Matrix4();
    this.fruits.forEach(({ x, y, z }, i) => {
      const r = radii[i]!;
      this.object.setMatrixAt(i, matrix.makeScale(r, r, r).setPosition(x, y, z));
    });
    this.object.instanceMatrix.needsUpdate = true;
  }

  colour(colours: Rgb[]): void {
    const colour = new three.Color();
    colours.forEach((rgb, i) => this.object.setColorAt(i, colour.setRGB(...rgb, three.SRGBColorSpace)));
    if (this.object.instanceColor) this.object.instanceColor.needsUpdate = true;
  }

  seeThrough(opacity: number): void {
    const material = this.object.material as three.Material;
    material.transparent = opacity < 1;
    material.opacity = opacity;
    material.depthWrite = opacity >= 1;
    material.needsUpdate = true;
  }
}

const VERTEX = `
attribute float radius;
attribute vec3 tint;
uniform float halfHeight;
varying vec3 seen;
void main() {
  vec4 eye = modelViewMatrix * vec4(position, 1.0);
  seen = tint;
  gl_Position = radius > 0.0 ? projectionMatrix * eye : vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = max(2.0, 2.0 * radius * projectionMatrix[1][1] * halfHeight / max(-eye.z, 1e-6));
}`;

const FRAGMENT = `
uniform float opacity;
varying vec3 seen;
void main() {
  vec2 at = 2.0 * gl_PointCoord - 1.0;
  float off = dot(at, at);
  if (off > 1.0) discard;
  float light = 0.5 + 0.5 * max(0.0, dot(vec3(at.x, -at.y, sqrt(1.0 - off)), vec3(0.0, 0.45, 0.893)));
  gl_FragColor = vec4(seen * light, opacity);
  #include <colorspace_fragment>
}`;

export class FruitDiscs implements FruitDrawing {
  readonly object: three.Points;
  private readonly material = new three.ShaderMaterial({
    vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: { halfHeight: { value: 1 }, opacity: { value: 1 } },
  });

  constructor(fruits: Fruit[]) {
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(Float32Array.from(fruits.flatMap(({ x, y, z }) => [x, y, z])), 3));
    geometry.setAttribute("radius", new three.BufferAttribute(new Float32Array(fruits.length), 1));
    geometry.setAttribute("tint", new three.BufferAttribute(new Float32Array(3 * fruits.length), 3));
    this.object = new three.Points(geometry, this.material);
    const size = new three.Vector2();
    this.object.onBeforeRender = (renderer) => {
      this.material.uniforms.halfHeight!.value = renderer.getDrawingBufferSize(size).y / 2;
    };
  }

  size(radii: Float32Array): void {
    this.set("radius", radii);
  }

  colour(colours: Rgb[]): void {
    const colour = new three.Color();
    this.set("tint", Float32Array.from(colours.flatMap((rgb) => colour.setRGB(...rgb, three.SRGBColorSpace).toArray())));
  }

  seeThrough(opacity: number): void {
    this.material.transparent = opacity < 1;
    this.material.depthWrite = opacity >= 1;
    this.material.uniforms.opacity!.value = opacity;
    this.material.needsUpdate = true;
  }

  private set(name: string, values: Float32Array): void {
    const attribute = this.object.geometry.getAttribute(name) as three.BufferAttribute;
    (attribute.array as Float32Array).set(values);
    attribute.needsUpdate = true;
  }
}
