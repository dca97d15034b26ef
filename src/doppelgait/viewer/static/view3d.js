// A camera that orbits a point: from metres in the room to pixels.

const LENS = 2.7; // focal length in half heights of the picture: about 40 degrees from top to bottom
const MARGIN = 42; // pixels

export function makeCamera() {
  const camera = {
    yaw: 0, pitch: 0.3, distance: 6, centre: [0, 0, 1],
    orbit, zoom, project, fit,
  };
  let [width, height] = [1, 1];
  return Object.assign(camera, { setSize: (w, h) => ([width, height] = [w, h]) });

  function orbit(dx, dy) {
    camera.yaw -= 0.008 * dx;
    camera.pitch = Math.min(Math.max(camera.pitch + 0.008 * dy, -0.1), Math.PI / 2);
  }

  function zoom(factor) {
    camera.distance = Math.min(Math.max(camera.distance * factor, 0.5), 200);
  }

  /** Pixel and depth in m of a point; null behind the camera. */
  function project([x, y, z]) {
    const [cy, sy] = [Math.cos(camera.yaw), Math.sin(camera.yaw)];
    const [cp, sp] = [Math.cos(camera.pitch), Math.sin(camera.pitch)];
    const [dx, dy, dz] = [x - camera.centre[0], y - camera.centre[1], z - camera.centre[2]];
    const forwards = -(dx * cy + dy * sy); // the camera stands at +yaw and looks at the centre
    const right = -dx * sy + dy * cy;
    const up = dz * cp + forwards * sp;
    const depth = camera.distance + forwards * cp - dz * sp;
    if (depth < 0.05) return null;
    const scale = (LENS * Math.min(height, width * 1.1)) / 2 / depth;
    return { x: width / 2 + right * scale, y: height / 2 - up * scale, depth, scale };
  }

  /** Stand so far off that all points are in the picture, in its middle. */
  function fit(points) {
    const [low, high] = bounds(points);
    camera.centre = low.map((value, axis) => (value + high[axis]) / 2);
    for (let round = 0; round < 3; round += 1) {
      for (camera.distance = 1; camera.distance < 150; camera.distance *= 1.04) {
        if (points.every(fits)) break;
      }
      centreOn(points.map(project));
    }
  }

  /** Whether a point would be in the picture, were its middle moved to where it is best. */
  function fits(point) {
    const at = project(point);
    return at && at.x > MARGIN && at.x < width - MARGIN && at.y > MARGIN && at.y < height - MARGIN;
  }

  /** Move the centre sideways and up so that points lie in the middle of the picture. */
  function centreOn(places) {
    const middle = (name) => (Math.min(...places.map((at) => at[name])) + Math.max(...places.map((at) => at[name]))) / 2;
    const scale = (LENS * Math.min(height, width * 1.1)) / 2 / camera.distance;
    const [right, up] = [(middle("x") - width / 2) / scale, (height / 2 - middle("y")) / scale];
    const [cy, sy] = [Math.cos(camera.yaw), Math.sin(camera.yaw)];
    const [cp, sp] = [Math.cos(camera.pitch), Math.sin(camera.pitch)];
    camera.centre = [
      camera.centre[0] - right * sy - up * cy * sp,
      camera.centre[1] + right * cy - up * sy * sp,
      camera.centre[2] + up * cp,
    ];
  }
}

/** Lowest and highest coordinates of points, unknown ones left out. */
export function bounds(points) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (const point of points) {
    if (!point.every(Number.isFinite)) continue;
    for (let axis = 0; axis < 3; axis += 1) {
      low[axis] = Math.min(low[axis], point[axis]);
      high[axis] = Math.max(high[axis], point[axis]);
    }
  }
  return [low, high];
}
