/**
 * Balls, many of them: each is a square that turns to the viewer and on which the ball's surface is computed.
 *
 * All are one mesh, not instances of one, which cost software renderers a drawing each.
 */

import * as three from "three";
import type { Rgb } from "./colours";

// The square touches the cone in which the eye sees the ball; a ball is never smaller than two pixels.
const VERTEX = `
attribute float radius;
attribute vec4 tint;
uniform float halfHeight;
varying vec3 offCenter;
varying vec3 eyeCenter;
varying float ball;
varying vec3 colour;
void main() {
  eyeCenter = (modelViewMatrix * vec4(position, 1.0)).xyz;
  float far = max(length(eyeCenter), 1e-6);
  ball = max(radius, far / (projectionMatrix[1][1] * halfHeight));
  vec3 ahead = eyeCenter / far;
  vec3 right = normalize(cross(ahead, abs(ahead.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0)));
  float side = ball / sqrt(max(1.0 - ball * ball / (far * far), 0.01));
  int corner = gl_VertexID % CORNERS;
  float across = corner == 1 || corner == 2 ? 1.0 : -1.0;
  float upward = corner >= 2 ? 1.0 : -1.0;
  offCenter = side * (across * right + upward * cross(right, ahead));
  colour = pow(tint.rgb, vec3(2.2));
  bool hidden = radius <= 0.0 || eyeCenter.z > 0.0 || ball >= far;
  gl_Position = hidden ? vec4(2.0, 2.0, 2.0, 1.0) : projectionMatrix * vec4(eyeCenter + offCenter, 1.0);
}`;

const FRAGMENT = `
uniform float opacity;
uniform mat4 projectionMatrix;
varying vec3 offCenter;
varying vec3 eyeCenter;
varying float ball;
varying vec3 colour;
void main() {
  // From the ball's centre to the ray's nearest point, and from there towards the eye to the surface.
  vec3 ray = normalize(eyeCenter + offCenter);
  vec3 nearest = offCenter - dot(offCenter, ray) * ray;
  float inside = ball * ball - dot(nearest, nearest);
  if (inside < 0.0) discard;
  vec3 surface = nearest - sqrt(inside) * ray;
  vec4 place = projectionMatrix * vec4(eyeCenter + surface, 1.0);
  gl_FragDepth = 0.5 * place.z / place.w + 0.5;
  float light = 0.5 + 0.55 * max(0.0, dot(surface / ball, vec3(0.0, 0.45, 0.893)));
  gl_FragColor = vec4(colour * light, opacity);
  #include <colorspace_fragment>
}`;

const CORNERS = 4;

export class Balls {
  readonly object: three.Mesh;
  private readonly geometry = new three.BufferGeometry();
  private readonly material = new three.ShaderMaterial({
    vertexShader: VERTEX, fragmentShader: FRAGMENT, defines: { CORNERS }, uniforms: { halfHeight: { value: 1 }, opacity: { value: 1 } },
  });

  /** `centers`: x, y and z of each in turn. All are hidden until they have a size. */
  constructor(centers: Float32Array) {
    const count = centers.length / 3;
    const index = new Uint32Array(6 * count);
    for (let i = 0; i < count; i++) index.set([0, 1, 2, 0, 2, 3].map((corner) => CORNERS * i + corner), 6 * i);
    this.geometry.setIndex(new three.BufferAttribute(index, 1));
    this.geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(3 * CORNERS * count), 3));
    this.geometry.setAttribute("radius", new three.BufferAttribute(new Float32Array(CORNERS * count), 1));
    this.geometry.setAttribute("tint", new three.BufferAttribute(new Uint8Array(4 * CORNERS * count), 4, true));
    this.fill("position", (i) => [centers[3 * i]!, centers[3 * i + 1]!, centers[3 * i + 2]!]);
    this.object = new three.Mesh(this.geometry, this.material);
    this.object.frustumCulled = false;
    const drawn = new three.Vector2();
    this.object.onBeforeRender = (renderer) => {
      this.material.uniforms.halfHeight!.value = renderer.getDrawingBufferSize(drawn).y / 2;
    };
  }

  /** Radii in the world; 0 hides a ball. */
  size(radius: (index: number) => number): void {
    this.fill("radius", (i) => [radius(i)]);
  }

  colour(of: (index: number) => Rgb): void {
    this.fill("tint", (i) => of(i).map((part) => Math.round(255 * part)));
  }

  seeThrough(opacity: number): void {
    this.material.transparent = opacity < 1;
    this.material.depthWrite = opacity >= 1;
    this.material.uniforms.opacity!.value = opacity;
    this.material.needsUpdate = true;
  }

  /** The same at all corners of a ball. */
  private fill(name: string, values: (index: number) => number[]): void {
    const attribute = this.geometry.getAttribute(name) as three.BufferAttribute;
    for (let i = 0; i < attribute.count / CORNERS; i++) {
      const each = values(i);
      for (let corner = 0; corner < CORNERS; corner++) attribute.array.set(each, attribute.itemSize * (CORNERS * i + corner));
    }
    attribute.needsUpdate = true;
  }
}
