// The data in the page, and the traces of an episode unpacked when they are wanted.

const data = JSON.parse(byId("data").textContent);
const episodes = data.episodes;

/** Place in the list by the index in the table. */
const placeOf = new Map(episodes.index.map((index, place) => [index, place]));

/** RECORDING:EPISODE, by which links and the command line know an episode. */
function nameOf(place) {
  return `${episodes.recordings[episodes.recording[place]]}:${episodes.id[place]}`;
}

function placeByName(name) {
  for (let place = 0; place < episodes.id.length; place++) {
    if (name.endsWith(episodes.id[place]) && nameOf(place) === name) return place;
  }
  return -1;
}

function environmentOf(place) {
  const environment = data.environments[episodes.environment[place]];
  return environment ? environment.name : "";
}

function jointName(joint) {
  if (joint.name) return joint.name;
  return joint.joint < 0 ? "all joints together" : `joint ${joint.joint}`;
}

function linkTo(place, joint, segment) {
  let hash = `#episode=${encodeURIComponent(nameOf(place))}`;
  if (segment !== undefined) hash += `&joint=${joint}&segment=${segment}`;
  return hash;
}

function bytesOf(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

function floatsOf(text) {
  const bytes = bytesOf(text);
  const view = new DataView(bytes.buffer);
  return Float64Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
}

function valuesOf(packed) {
  if (!packed) return null;
  if (packed.floats) return floatsOf(packed.floats.bytes);
  const { values, bytes } = packed.indexed;
  return Float64Array.from(bytesOf(bytes), (i) => (i < values.length ? values[i] : NaN));
}

/** A change and its measure, of which one is the other scaled. */
function changeOf(packed) {
  if (!packed) return { change: null, measure: null };
  const bytes = bytesOf(packed.bytes);
  const view = new DataView(bytes.buffer);
  const scaled = ([low, high]) =>
    Float64Array.from({ length: bytes.length / 2 }, (_, i) => low + (view.getUint16(2 * i, true) / 65535) * (high - low));
  return { change: scaled(packed.change), measure: scaled(packed.measure) };
}

/** The traces of an episode by its index in the table; null if the page has none. */
function traceOf(index) {
  const script = byId(`trace-${index}`);
  if (!script) return null;
  const packed = JSON.parse(script.textContent);
  const n = Math.ceil(packed.n_steps / packed.stride);
  const bits = (text, bit) => (text ? Array.from(bytesOf(text), (b) => (b >> bit) & 1) : null);
  return {
    nSteps: packed.n_steps,
    stride: packed.stride,
    nMoreJoints: packed.n_more_joints,
    startTime: packed.start_time,
    steps: Float64Array.from({ length: n }, (_, i) => i * packed.stride),
    seconds: packed.seconds ? floatsOf(packed.seconds) : null,
    state: { ...changeOf(packed.state.change), mask: bits(packed.state.mask, 0) },
    joints: packed.joints.map((joint) => ({
      joint: joint.joint,
      name: joint.name,
      action: valuesOf(joint.action),
      ...changeOf(joint.change),
      mask: bits(joint.flags, 0),
      correlated: bits(joint.flags, 1),
      boundaries: joint.boundaries,
      segments: joint.segments.map(([start, end, sum, peak, rank]) => ({ start, end, sum, peak, rank })),
    })),
  };
}
