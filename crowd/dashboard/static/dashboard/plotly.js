// Loads Plotly when the first chart or file needs it: where the server draws the chart, few visitors do.
"use strict";

const { library } = document.currentScript.dataset;
let loading;

globalThis.plotly = () => {
  loading ??= new Promise((done, failed) => {
    const script = document.createElement("script");
    script.src = library;
    // It brings a map library that writes an inline style sheet unless an element has this id; no chart is a map.
    script.id = "9f215cf04c5486422605d13261cb87401f4e7763b6296af81e98efbc0130da53";
    script.onload = () => done(window.Plotly);
    script.onerror = () => failed(new Error("Plotly could not be loaded"));
    document.head.append(script);
  });
  return loading;
};
