// Two models in one canvas, seen by one camera: side by side, or one over the other with a slider between them.
import {
  Box3,
  BoxGeometry,
  BufferGeometry,
  DirectionalLight,
  EdgesGeometry,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  NeutralToneMapping,
  PMREMGenerator,
  PerspectiveCamera,
  Plane,
  Ray,
  Raycaster,
  Scene,
  Sphere,
  SphereGeometry,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";

const HANDLES = [0, 1, 2].flatMap((axis) => [0, 1].map((end) => ({ axis, end })));
const RED = 0xd7443e;
const GREEN = 0x2b9a66;
const LIMIT = 300_000; // triangles up to which marks behind the model are found by casting rays

export class Viewer {
  /** A viewer in an element; `listeners` has `moved` (each frame), `picked` (a part) and `boxes` (a box was changed). */
  constructor(element, listeners) {
    this.element = element;
    this.listeners = listeners;
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    element.append(this.canvas);
    this.scenes = { before: new Scene(), after: new Scene() };
    this.models = { before: null, after: null };
    this.camera = new PerspectiveCamera(32, 1, 0.01, 100);
    this.lights = Object.values(this.scenes).map(lit);
    if (!isSlow(this.renderer)) {
      const room = new PMREMGenerator(this.renderer).fromScene(new RoomEnvironment(), 0.03).texture;
      for (const scene of Object.values(this.scenes)) Object.assign(scene, { environment: room, environmentIntensity: 0.5 });
    }
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = !still();
    this.controls.dampingFactor = 0.12;
    this.controls.addEventListener("change", () => this.invalidate());
    this.controls.listenToKeyEvents(this.canvas);
    this.controls.keyPanSpeed = 20;
    this.layout = "single";
    this.split = 0.5;
    this.boxes = [];
    this.boxGroup = new Group();
    this.scenes.before.add(this.boxGroup);
    this.caster = new Raycaster();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(element);
    this.canvas.addEventListener("pointerdown", this.press, { capture: true });
    this.canvas.addEventListener("pointermove", this.drag);
    this.canvas.addEventListener("pointerup", this.release);
    this.resize();
  }

  dispose() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }

  /** Put a model (or null) into a place; the camera goes round the first one. */
  show(place, object) {
    const first = !this.models.before && !this.models.after;
    if (this.models[place] === object) return;
    if (this.models[place]) this.scenes[place].remove(this.models[place]);
    this.models[place] = object;
    if (object) {
      this.scenes[place].add(object);
      this.triangles = count(object);
      if (first || place === "before") this.fit();
    }
    this.invalidate();
  }

  /** Look at the whole model. */
  fit() {
    const object = this.models.before ?? this.models.after;
    if (!object) return;
    this.sphere = new Box3().setFromObject(object, true).getBoundingSphere(new Sphere());
    if (!(this.sphere.radius > 0)) this.sphere.radius = 1;
    const direction = new Vector3(0.75, 0.42, 1).normalize();
    this.controls.minDistance = this.sphere.radius * 0.08;
    this.controls.maxDistance = this.sphere.radius * 12;
    this.move(this.sphere.center.clone().addScaledVector(direction, this.distance()), this.sphere.center, true);
  }

  /** Look at the whole model from a direction. */
  lookFrom(direction) {
    const toward = new Vector3(...direction);
    // Straight above, the camera would have no up: it comes a little from the front.
    if (Math.abs(toward.y) > 0.95) toward.add(new Vector3(0, 0, 0.05)).normalize();
    this.move(this.sphere.center.clone().addScaledVector(toward, this.distance()), this.sphere.center);
  }

  /** Small pictures of the result from some views ({direction, up}), as they are read: PNG in blobs. */
  pictures(views, side = 160) {
    const camera = new PerspectiveCamera(this.camera.fov, 1, this.sphere.radius * 0.5, this.sphere.radius * 12);
    const away = (this.sphere.radius * 1.04) / Math.sin((camera.fov * Math.PI) / 360);
    const taken = views.map(({ direction, up }) => {
      const picture = Object.assign(document.createElement("canvas"), { width: side, height: side });
      camera.up.set(...up);
      camera.position.copy(this.sphere.center).addScaledVector(new Vector3(...direction), away);
      camera.lookAt(this.sphere.center);
      camera.updateMatrixWorld();
      for (const light of this.lights) light.quaternion.copy(camera.quaternion);
      this.renderer.setScissorTest(true);
      this.renderer.setViewport(0, 0, side, side);
      this.renderer.setScissor(0, 0, side, side);
      this.renderer.render(this.scenes.after, camera);
      const drawn = side * this.renderer.getPixelRatio();
      picture.getContext("2d").drawImage(this.canvas, 0, this.canvas.height - drawn, drawn, drawn, 0, 0, side, side);
      return new Promise((done) => picture.toBlob(done));
    });
    this.draw();
    return Promise.all(taken);
  }

  distance() {
    const half = (this.camera.fov * Math.PI) / 360;
    const { width, height } = this.pane();
    return (this.sphere.radius * 1.12) / Math.sin(Math.min(half, Math.atan(Math.tan(half) * (width / height))));
  }

  /** Fly the camera to a mark. */
  fly(mark) {
    const center = new Vector3(...mark.center);
    const away = Math.min(Math.max(mark.size[0] * 3.4, this.sphere.radius * 0.3), this.distance());
    const direction = new Vector3(...mark.normal);
    // Straight above, the camera would have no up: it comes a little from the front.
    if (Math.abs(direction.y) > 0.95) direction.add(new Vector3(0, 0, 0.35)).normalize();
    this.move(center.clone().addScaledVector(direction, away), center);
  }

  move(position, target, atOnce = false) {
    cancelAnimationFrame(this.flight);
    const [from, aim] = [this.camera.position.clone(), this.controls.target.clone()];
    const began = performance.now();
    const step = (now) => {
      const t = atOnce || still() ? 1 : Math.min(1, (now - began) / 650);
      const eased = t < 0.5 ? 4 * t ** 3 : 1 - (2 - 2 * t) ** 3 / 2;
      const middle = aim.clone().lerp(target, eased);
      // Round the model rather than through it: direction and distance change by themselves.
      const [a, b] = [from.clone().sub(aim), position.clone().sub(target)];
      const length = a.length() + (b.length() - a.length()) * eased;
      const way = a.normalize().lerp(b.normalize(), eased);
      if (way.lengthSq() < 1e-4) way.set(0, 0.3, 1);
      this.camera.position.copy(middle).addScaledVector(way.normalize(), t === 1 ? position.distanceTo(target) : length);
      if (t === 1) this.camera.position.copy(position);
      this.controls.target.copy(middle);
      this.controls.update();
      this.invalidate();
      if (t < 1) this.flight = requestAnimationFrame(step);
    };
    step(began);
  }

  /** Arrange the two; what was seen of the model is seen in its new room too. */
  setLayout(layout) {
    const before = this.sphere && this.distance();
    this.layout = layout;
    this.resize();
    if (!before) return;
    const { target } = this.controls;
    this.camera.position.sub(target).multiplyScalar(this.distance() / before).add(target);
    this.controls.update();
    this.invalidate();
  }

  setSplit(split) {
    this.split = split;
    this.invalidate();
  }

  /** Size of one picture, and where that of the marks begins, in CSS pixels. */
  pane() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (this.layout !== "side") return { width, height, left: 0, top: 0 };
    return width >= height
      ? { width: width / 2, height, left: width / 2, top: 0 }
      : { width, height: height / 2, left: 0, top: height / 2 };
  }

  resize() {
    const { clientWidth, clientHeight } = this.element;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    const { width, height } = this.pane();
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  invalidate() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.controls.update();
      this.draw();
    });
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (this.sphere) {
      const away = this.camera.position.distanceTo(this.sphere.center);
      this.camera.near = Math.max(away - this.sphere.radius * 2, this.sphere.radius * 0.01);
      this.camera.far = away + this.sphere.radius * 4;
      this.camera.updateProjectionMatrix();
    }
    this.camera.updateMatrixWorld();
    for (const light of this.lights) light.quaternion.copy(this.camera.quaternion);
    this.sizeHandles();
    this.renderer.setScissorTest(true);
    const part = (place, view, cut) => {
      this.renderer.setViewport(...view);
      this.renderer.setScissor(...cut);
      this.renderer.render(this.scenes[place], this.camera);
    };
    const whole = [0, 0, width, height];
    if (this.layout === "side") {
      const pane = this.pane();
      const first = pane.left ? [0, 0, pane.width, height] : [0, pane.height, width, pane.height];
      const second = pane.left ? [pane.left, 0, pane.width, height] : [0, 0, width, pane.height];
      part("before", first, first);
      part("after", second, second);
    } else if (this.layout === "split") {
      const x = Math.round(width * this.split);
      if (x > 0) part("before", whole, [0, 0, x, height]);
      if (x < width) part("after", whole, [x, 0, width - x, height]);
    } else {
      part(this.models.after ? "after" : "before", whole, whole);
    }
    this.listeners.moved?.();
  }

  /** Where a sign for a mark stands on the screen, just above it: {x, y, seen}. */
  project(mark) {
    const point = new Vector3(...mark.center);
    const up = new Vector3(...mark.normal).cross(new Vector3(...mark.right));
    const above = point.clone().addScaledVector(up, (mark.size[1] ?? 0) / 2).project(this.camera);
    const toward = this.camera.position.clone().sub(point).normalize();
    const facing = toward.dot(new Vector3(...mark.normal)) > 0.12;
    const { width, height, left, top } = this.pane();
    const screen = point.clone().project(this.camera);
    const [x, y] = [left + ((above.x + 1) / 2) * width, top + ((1 - above.y) / 2) * height - 17];
    const inside = Math.abs(screen.x) < 1 && Math.abs(screen.y) < 1 && screen.z < 1;
    const uncut = this.layout !== "split" || x > this.element.clientWidth * this.split;
    return { x, y, seen: facing && inside && uncut };
  }

  /** Whether a part of the model stands before a mark. */
  isHidden(mark) {
    const model = this.models.after ?? this.models.before;
    if (!model || this.triangles > LIMIT || !this.sphere) return false;
    const point = new Vector3(...mark.center);
    const toward = this.camera.position.clone().sub(point).normalize();
    this.caster.set(point.addScaledVector(toward, this.sphere.radius * 0.02), toward);
    return this.caster.intersectObject(model, true).length > 0;
  }

  /** Show boxes: [{min, max, kind: "keep_out"|"prefer"}]; the one at `selected` has handles. */
  setBoxes(boxes, selected) {
    this.boxes = boxes;
    this.selected = selected;
    this.boxGroup.traverse((each) => each.geometry?.dispose());
    this.boxGroup.clear();
    this.handles = [];
    boxes.forEach((box, index) => {
      const [low, high] = [new Vector3(...box.min), new Vector3(...box.max)];
      const size = high.clone().sub(low);
      const color = box.kind === "keep_out" ? RED : GREEN;
      const solid = new BoxGeometry(...size.toArray().map((side) => Math.max(side, 1e-9)));
      const body = new Mesh(
        solid,
        new MeshBasicMaterial({ color, transparent: true, opacity: 0.16, depthWrite: false, toneMapped: false }),
      );
      const edges = new LineSegments(new EdgesGeometry(solid), new LineBasicMaterial({ color, toneMapped: false }));
      body.position.copy(low).add(high).multiplyScalar(0.5);
      edges.position.copy(body.position);
      this.boxGroup.add(body, edges);
      if (index !== selected) return;
      const ball = new SphereGeometry(1, 20, 14);
      for (const place of [...HANDLES, { axis: -1 }]) {
        const handle = new Mesh(ball, new MeshBasicMaterial({ color, depthTest: false, transparent: true, toneMapped: false }));
        handle.renderOrder = 2;
        handle.userData = place;
        handle.position.copy(body.position);
        if (place.axis >= 0) handle.position.setComponent(place.axis, (place.end ? high : low).getComponent(place.axis));
        this.boxGroup.add(handle);
        this.handles.push(handle);
      }
    });
    this.invalidate();
  }

  sizeHandles() {
    for (const handle of this.handles ?? []) {
      const away = this.camera.position.distanceTo(handle.position);
      handle.scale.setScalar(away * (handle.userData.axis < 0 ? 0.0062 : 0.0048));
    }
  }

  /** A box in the middle of what is seen. */
  newBox() {
    const side = this.sphere.radius * 0.3;
    const round = (value) => Number(value.toPrecision(4));
    const middle = this.sphere.center.clone();
    const toward = this.camera.position.clone().sub(middle).normalize();
    this.caster.set(this.camera.position, toward.clone().negate());
    const hit = this.models.before && this.caster.intersectObject(this.models.before, true)[0];
    if (hit) middle.copy(hit.point);
    return {
      min: middle.toArray().map((value) => round(value - side)),
      max: middle.toArray().map((value) => round(value + side)),
    };
  }

  ray(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - left) / width) * 2 - 1, 1 - ((event.clientY - top) / height) * 2);
    this.caster.setFromCamera(at, this.camera);
    return this.caster.ray;
  }

  press = (event) => {
    this.pressed = [event.clientX, event.clientY];
    if (!this.handles?.length) return;
    this.ray(event);
    this.handles.forEach((handle) => handle.scale.multiplyScalar(1.8)); // easier to hit than to see
    this.boxGroup.updateMatrixWorld(true);
    const hit = this.caster.intersectObjects(this.handles, false)[0];
    this.sizeHandles();
    if (!hit) return;
    event.stopImmediatePropagation();
    this.canvas.setPointerCapture(event.pointerId);
    this.dragged = hit.object;
    this.start = { box: structuredClone(this.boxes[this.selected]), point: this.along(event) };
  };

  /** Where the pointer is on the axis of the dragged handle, or on the plane before the camera. */
  along(event) {
    const ray = this.ray(event);
    const { axis } = this.dragged.userData;
    const origin = this.dragged.position;
    if (axis < 0) {
      const plane = new Plane().setFromNormalAndCoplanarPoint(this.camera.getWorldDirection(new Vector3()), origin);
      return ray.intersectPlane(plane, new Vector3()) ?? origin.clone();
    }
    const line = new Vector3().setComponent(axis, this.sphere.radius * 20);
    const point = new Vector3();
    new Ray(ray.origin, ray.direction).distanceSqToSegment(origin.clone().sub(line), origin.clone().add(line), null, point);
    return point;
  }

  drag = (event) => {
    if (!this.dragged) return;
    const { axis, end } = this.dragged.userData;
    const shift = this.along(event).sub(this.start.point);
    const box = structuredClone(this.start.box);
    const round = (value) => Number(value.toPrecision(5));
    if (axis < 0) {
      for (const k of [0, 1, 2]) {
        box.min[k] = round(box.min[k] + shift.getComponent(k));
        box.max[k] = round(box.max[k] + shift.getComponent(k));
      }
    } else {
      const side = end ? "max" : "min";
      box[side][axis] = round(box[side][axis] + shift.getComponent(axis));
      if (box.min[axis] > box.max[axis]) [box.min[axis], box.max[axis]] = [box.max[axis], box.min[axis]];
    }
    this.pending = box;
    this.redrawBox(box);
  };

  redrawBox(box) {
    const dragged = this.dragged.userData;
    const boxes = this.boxes.map((each, index) => (index === this.selected ? box : each));
    this.setBoxes(boxes, this.selected);
    this.dragged = this.handles.find((h) => h.userData.axis === dragged.axis && h.userData.end === dragged.end);
  }

  release = (event) => {
    if (this.dragged) {
      this.dragged = null;
      if (this.pending) this.listeners.boxes?.(this.selected, this.pending);
      this.pending = null;
      return;
    }
    const moved = this.pressed && Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]);
    if (moved > 4 || !this.picking || !this.models.before) return;
    this.ray(event);
    const hit = this.caster.intersectObject(this.models.before, true)[0];
    if (!hit) return;
    const { material } = hit.object;
    const used = Array.isArray(material) ? material[hit.face?.materialIndex ?? 0] : material;
    let named = hit.object;
    while (named && !named.userData.region) named = named.parent;
    this.listeners.picked?.({ node: named?.userData.region ?? null, material: used?.name || null });
  };
}

// Lights that turn with the camera: one from above at the left, a weaker one from the right, and from all round.
function lit(scene) {
  const group = new Group();
  const lamp = (strength, ...from) => {
    const light = new DirectionalLight(0xffffff, strength);
    light.position.set(...from);
    group.add(light, light.target);
  };
  lamp(2.3, -0.7, 1.1, 1);
  lamp(0.7, 1.2, 0.1, 0.5);
  scene.add(group, new HemisphereLight(0xffffff, 0x9aa0ad, 1.25));
  return group;
}

// Where the processor draws, reflections of a room would take many seconds to prepare.
function isSlow(renderer) {
  const gl = renderer.getContext();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return !info || /swiftshader|llvmpipe|software/i.test(gl.getParameter(info.UNMASKED_RENDERER_WEBGL));
}

const still = () => window.matchMedia("(prefers-reduced-motion: reduce)").matches;

function count(object) {
  let triangles = 0;
  object.traverse((each) => {
    if (each.geometry instanceof BufferGeometry)
      triangles += (each.geometry.index?.count ?? each.geometry.getAttribute("position")?.count ?? 0) / 3;
  });
  return triangles;
}
