"use strict";

const SPAN_S = 10;
const page = Object.fromEntries(
  ["stages", "state", "faults", "arm", "stop", "estop", "message", "chart"].map((id) => [id, document.getElementById(id)]),
);
const waiting = new Map(); // number of a message: what to do with its answer
let socket = null;
let number = 0;
let stage = "";
let chart = null;
let data = [[], [], []]; // time in s since 1970, command and position in µm

function send(message) {
  return new Promise((done) => {
    const id = ++number;
    waiting.set(id, done);
    socket.send(JSON.stringify({ id, ...message }));
  });
}

async function say(message) {
  const answer = await send(message);
  page.message.textContent = answer.ok ? "" : `${answer.error.what}; ${answer.error.remedy}`;
  return answer;
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.onopen = list;
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = () => {
    page.message.textContent = "no connection to piezod web; trying again";
    waiting.clear();
    setTimeout(connect, 1000);
  };
}

function take(message) {
  if ("id" in message) {
    waiting.get(message.id)?.(message);
    waiting.delete(message.id);
  } else if (message.event === "telemetry" && message.stage === stage) {
    plot(message);
  } else if (message.event === "status" && message.stage === stage) {
    show(message.status);
  } else if (message.event === "stage") {
    if (message.stage === stage && !message.up) page.state.textContent = `down since ${message.since}`;
    list();
  }
}

async function list() {
  const answer = await say({ do: "stages" });
  if (!answer.ok) return;
  page.stages.replaceChildren(...answer.result.stages.map((each) => new Option(each.stage, each.stage)));
  if (stage) page.stages.value = stage;
  else if (answer.result.stages.length) watch();
}

async function watch() {
  stage = page.stages.value;
  data = [[], [], []];
  const answer = await say({ do: "watch", stage, rate_hz: 30 });
  if (answer.ok && answer.result.status) show(answer.result.status);
}

function show(status) {
  page.state.textContent = `${status.state} · ${status.mode}`;
  page.faults.textContent = status.faults.map((each) => `${each.id} ${each.name}`).join(", ");
}

function plot(message) {
  const axis = Object.values(message.axes)[0];
  message.unix_s.forEach((time_s, row) => {
    data[0].push(time_s);
    data[1].push(axis.command_um.last[row]);
    data[2].push(axis.position_um.last[row]);
  });
  const first = data[0].findIndex((time_s) => time_s > data[0].at(-1) - SPAN_S);
  data = data.map((column) => column.slice(first));
  requestAnimationFrame(() => (chart ??= newChart()).setData(data));
}

function newChart() {
  const width = page.chart.clientWidth - 32;
  return new uPlot({
    width,
    height: 420,
    series: [{}, { label: "command, µm", stroke: "#1f77b4" }, { label: "position, µm", stroke: "#d62728" }],
  }, data, page.chart);
}

page.stages.onchange = watch;
page.arm.onclick = () => say({ do: "call", stage, method: "POST", path: "/v1/arm", body: {} });
page.stop.onclick = () => say({ do: "call", stage, method: "POST", path: "/v1/stop", body: {} });
page.estop.onclick = () => say({ do: "estop", stage });
document.onvisibilitychange = () => (document.hidden ? send({ do: "unwatch" }) : watch());
connect();
