// The reference that the station judges against, from the report beside its file.
"use strict";

const kReferenceAbout = [["left-out", "Left out"], ["parts", "The parts"], ["variation", "What varies between good parts"], ["false-rejects", "Good parts that will be rejected"], ["flaws", "Flaws that will be found"]];
const reference = { asked: 0, report: false };
const shareInWords = (share) => `${Number((100 * share).toPrecision(2))} %`;

function referenceFigures(shown, report) {
  const flaws = report.flaws.map((flaw) => [`${flaw.kind}, ${flaw.size}`, known(flaw.a90) ? Number(flaw.a90.toPrecision(2)) : "not found", known(flaw.a90) ? `${flaw.unit} found in 9 of 10 cases` : "in 9 of 10 cases at any size tried"]);
  const rejects = report.false_rejects && known(report.false_rejects.bound) ? [["good parts rejected, at most", shareInWords(report.false_rejects.bound), "95 % sure"]] : [];
  return [["learned from", shown.parts, "distinct parts"], ["left out", report.left_out.length, "parts"], ["learned", ...timeFigure(Date.parse(report.learned))], ...rejects, ...flaws];
}

function showReport(shown) {
  const report = shown.report;
  reference.report = Boolean(report);
  figures("reference", report ? referenceFigures(shown, report) : known(shown.parts) ? [["learned from", shown.parts, "distinct parts"]] : []);
  $("reference-told").replaceChildren(...kReferenceAbout.flatMap(([about, title]) => {
    const told = report ? report.sentences.filter((sentence) => sentence.about === about) : [];
    if (!told.length) return [];
    const group = element("div"), list = element("ul");
    list.append(...told.map((sentence) => element("li", sentence.text)));
    group.append(element("h3", title), list);
    return [group];
  }));
  const picture = report && report.picture && report.picture.crc32 ? report.picture : null;
  $("reference-details").hidden = !picture;
  const address = picture ? `/reference/${picture.crc32}.png` : "";
  if ($("reference-picture").dataset.address === address) return;
  const image = $("reference-picture");
  image.dataset.address = address;
  image.removeAttribute("src");
  image.alt = picture ? `Maps of light and deflection. ${report.sentences.filter((s) => s.about === "variation").map((s) => s.text).join(" ")}` : "";
  if (picture && known(picture.width) && known(picture.height)) { image.width = picture.width; image.height = picture.height; }
  showReferencePicture();
}

// The picture is large: it is loaded when somebody wants to see it.
function showReferencePicture() {
  const image = $("reference-picture");
  if (!$("reference-details").open || !image.dataset.address || image.hasAttribute("src")) return;
  say("reference-picture-said", "");
  image.src = image.dataset.address;
}
$("reference-picture").addEventListener("error", () => {
  if ($("reference-picture").hasAttribute("src")) say("reference-picture-said", "The picture cannot be shown: it is damaged, or another reference is in use.");
});
$("reference-details").addEventListener("toggle", showReferencePicture);

async function showReference() {
  const mine = ++reference.asked;
  try {
    const shown = await ask("/api/reference");
    if (mine !== reference.asked) return;
    const judges = shown.file ? `The station judges against ${shown.file}. Its recipe has named it since ${stamp(shown.since)}.` : "";
    say("reference-words", [judges, shown.note].filter(Boolean).join(" "));
    showReport(shown);
  } catch (error) {
    if (mine === reference.asked) say("reference-words", error.message);
  }
}
// A report comes minutes after its reference.
setInterval(() => { if (!document.hidden && !reference.report) showReference(); }, 30000);
