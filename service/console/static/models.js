// Files to three.js objects and facts, in this browser alone: nothing is sent.
import { Box3, BufferGeometry, DoubleSide, Mesh, MeshStandardMaterial, Points, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { OBJLoader } from "three/addons/loaders/OBJLoader.js";
import { PLYLoader } from "three/addons/loaders/PLYLoader.js";
import { STLLoader } from "three/addons/loaders/STLLoader.js";

const COMPRESSION = {
  KHR_draco_mesh_compression: "Draco",
  EXT_meshopt_compression: "meshopt",
  KHR_meshopt_compression: "meshopt",
  KHR_texture_basisu: "KTX2",
};

/** A file that is not shown here, with the key of the sentence that says why. */
export class NotShown extends Error {
  constructor(key, values = {}, facts = null) {
    super(key);
    Object.assign(this, { key, values, facts });
  }
}

/** Object and facts of a file; throws NotShown where this browser cannot show it. */
export async function readModel(file) {
  const bytes = await file.arrayBuffer();
  const kind = file.name.toLowerCase().split(".").pop();
  const readers = { glb: readGlb, gltf: readGltf, stl: readStl, ply: readPly, obj: readObj };
  if (!readers[kind]) throw new NotShown("notshown.format", { kind: kind.toUpperCase() });
  let read;
  try {
    read = await readers[kind](bytes);
  } catch (error) {
    if (error instanceof NotShown) throw error;
    throw new NotShown("notshown.unreadable");
  }
  return { ...read, facts: measure(read) };
}

async function readGlb(bytes) {
  const view = new DataView(bytes);
  if (bytes.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67) throw new NotShown("notshown.unreadable");
  return parse(bytes, JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, view.getUint32(12, true)))));
}

async function readGltf(bytes) {
  const document = JSON.parse(new TextDecoder().decode(bytes));
  for (const part of [...(document.buffers ?? []), ...(document.images ?? [])]) {
    if (part.uri?.startsWith("data:")) part.uri = blobUrl(part.uri);
    else if (part.uri) throw new NotShown("notshown.parts");
  }
  return parse(JSON.stringify(document), document);
}

// The page's policy lets nobody fetch data: addresses.
function blobUrl(uri) {
  const [head, body] = [uri.slice(5, uri.indexOf(",")), uri.slice(uri.indexOf(",") + 1)];
  const text = head.endsWith(";base64") ? atob(body) : decodeURIComponent(body);
  return URL.createObjectURL(new Blob([Uint8Array.from(text, (c) => c.charCodeAt(0))], { type: head.split(";")[0] }));
}

async function parse(data, document) {
  const needed = (document.extensionsRequired ?? []).map((name) => COMPRESSION[name]).find(Boolean);
  if (needed) throw new NotShown("notshown.compressed", { kind: needed }, countGltf(document));
  const outside = [...(document.buffers ?? []), ...(document.images ?? [])].some((p) => p.uri && !/^blob:/.test(p.uri));
  if (outside) throw new NotShown("notshown.parts");
  const gltf = await new GLTFLoader().parseAsync(data, "");
  const object = gltf.scene ?? gltf.scenes[0];
  if (!object) throw new NotShown("notshown.unreadable");
  // Names of regions are those in the file: three changes some.
  object.traverse((each) => {
    const place = gltf.parser.associations.get(each);
    if (place?.nodes === undefined) return;
    const node = document.nodes[place.nodes];
    each.userData.region = node.name ?? document.meshes?.[node.mesh]?.name ?? null;
  });
  return { object, materials: document.materials?.length ?? 0, textures: document.images?.length ?? 0 };
}

function countGltf(document) {
  let faces = 0;
  for (const mesh of document.meshes ?? [])
    for (const part of mesh.primitives) {
      const accessor = document.accessors?.[part.indices ?? part.attributes?.POSITION];
      if ((part.mode ?? 4) === 4) faces += Math.floor((accessor?.count ?? 0) / 3);
    }
  return { faces, materials: document.materials?.length ?? 0, textures: document.images?.length ?? 0, size: null };
}

// As the service writes what has no material, so that original and result look alike.
function clay(colored = false) {
  const material = new MeshStandardMaterial({ vertexColors: colored, roughness: 0.7, side: DoubleSide });
  material.color.setScalar(colored ? 1 : 0.8);
  return material;
}

function plain(geometry) {
  if (!geometry.getAttribute("normal")) geometry.computeVertexNormals();
  return { object: new Mesh(geometry, clay(Boolean(geometry.getAttribute("color")))), materials: 0, textures: 0 };
}

const readStl = async (bytes) => plain(new STLLoader().parse(bytes));
const readPly = async (bytes) => plain(new PLYLoader().parse(bytes));

async function readObj(bytes) {
  const object = new OBJLoader().parse(new TextDecoder().decode(bytes));
  const names = new Set();
  object.traverse((each) => {
    if (!each.isMesh) return;
    const many = Array.isArray(each.material);
    (many ? each.material : [each.material]).forEach((material) => material.name && names.add(material.name));
    const colored = Boolean(each.geometry.getAttribute("color"));
    const named = (material) => Object.assign(clay(colored), { name: material.name });
    each.material = many ? each.material.map(named) : named(each.material);
  });
  return { object, materials: names.size, textures: 0 };
}

function measure({ object, materials, textures }) {
  let faces = 0;
  object.updateMatrixWorld(true);
  object.traverse((each) => {
    if (each.isMesh && !(each instanceof Points) && each.geometry instanceof BufferGeometry) {
      const { index, attributes } = each.geometry;
      faces += Math.floor((index ? index.count : (attributes.position?.count ?? 0)) / 3) * (each.count ?? 1);
    }
  });
  if (!faces) throw new NotShown("notshown.empty");
  const size = new Box3().setFromObject(object, true).getSize(new Vector3()).toArray();
  return { faces, materials, textures, size };
}
