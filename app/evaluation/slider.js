  // In every element with data-scene: two of `pictures[scene]`, one over the other, and a slider that clips the upper one.
  for (const box of document.querySelectorAll("[data-scene]")) {
    const scene = pictures[box.dataset.scene], [under, over] = box.querySelectorAll("img");
    const [left, right] = box.querySelectorAll("select"), cut = box.querySelector("input");
    const reference = box.dataset.reference || "reference";
    for (const select of [left, right])
      for (const [kind, prefix] of [["picture", ""], ["flip", "FLIP map: "]])
        for (const label in scene)
          if (kind == "picture" || label != reference) select.add(new Option(prefix + label, kind + "/" + label));
    const source = select => { const [kind, ...label] = select.value.split("/"); return scene[label.join("/")][kind]; };
    const update = () => {
      over.src = source(left); under.src = source(right);
      over.style.clipPath = `inset(0 ${100 - cut.value}% 0 0)`;
    };
    left.value = "picture/" + box.dataset.first; right.value = "picture/" + reference;
    for (const control of [left, right, cut]) control.oninput = update;
    update();
  }
