// Pointers and wheel on the map: one finger or the left button works a tool or pans, two fingers pan, zoom and turn.

/**
 * @param canvas The map.
 * @param camera Its camera.
 * @param tool Has `isOn`, `press(x, y)`, `drag(x, y)`, `release()`, `abandon()`, in pixels of the canvas.
 * @param changed Called when the camera or the tool has changed.
 */
export function listen(canvas, camera, tool, changed) {
  const down = new Map();
  let works = false;
  let pair = null;

  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const pairOf = () => {
    const [[ax, ay], [bx, by]] = [...down.values()];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, span: Math.hypot(bx - ax, by - ay), angle: Math.atan2(by - ay, bx - ax) };
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, at(event));
    if (down.size === 1 && tool.isOn && event.button === 0) {
      works = true;
      tool.press(...at(event));
    } else if (down.size === 2) {
      if (works) tool.abandon();
      works = false;
      pair = pairOf();
    }
    changed();
  });

  canvas.addEventListener("pointermove", (event) => {
    if (!down.has(event.pointerId)) return;
    const [x, y] = at(event);
    const [lastX, lastY] = down.get(event.pointerId);
    down.set(event.pointerId, [x, y]);
    if (down.size === 2) {
      const now = pairOf();
      if (!camera.follows) camera.pan(now.x - pair.x, now.y - pair.y);
      camera.zoom(now.span / Math.max(pair.span, 1), now.x, now.y, pair.angle - now.angle);
      pair = now;
    } else if (works) {
      tool.drag(x, y);
    } else if (down.size === 1) {
      camera.pan(x - lastX, y - lastY);
    }
    changed();
  });

  const up = (event) => {
    if (!down.delete(event.pointerId)) return;
    if (works && event.type === "pointerup") tool.release();
    else if (works) tool.abandon();
    works = false;
    pair = null;
    changed();
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? event.deltaY * 20 : event.deltaY;
    if (event.shiftKey) camera.zoom(1, ...at(event), -(lines || event.deltaX) / 500);
    else camera.zoom(Math.exp(-lines / 400), ...at(event));
    changed();
  }, { passive: false });
}

