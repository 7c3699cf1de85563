// What a rig is used for: now, as it tells itself, or last, as the station tells that only reads it.

// Whether a campaign that is told is that of a station that reads, and so none.
export const ofStation = (campaign) => campaign?.activity?.startsWith("idle:") ?? false;

// What is shown as the campaign: what the rig tells, or, where only its station reads it, what drove it last.
export const shownUse = ({ sections }) => (ofStation(sections.campaign) && sections.last?.campaign ? sections.last : sections);

// What drove the rig last, if its station reads it and nobody has seen yet how that ended; or null.
export function unseenUse(link) {
  const use = shownUse(link);
  return use === link.sections || use.acknowledged.by ? null : use;
}

// Trips of earlier uses of the rig that nobody has acknowledged. While somebody drives it, they cannot be acknowledged.
export const unseenTrips = ({ sections }) => sections.last?.unseen ?? [];

// Whether something that has ended waits for somebody to acknowledge it to the station.
export const waitsToBeSeen = (link) => unseenUse(link) !== null || (ofStation(link.sections.campaign) && unseenTrips(link).length > 0);

// A run that was started here and has not ended; it may be on its way still, or writing its report.
export const underWay = ({ common }) => (common.launch?.last?.exit_code === null ? common.launch.last : null);

// Whether a run is known to be on another rig than the one that is shown. By its file's name a rig that is not heard is not known.
export const isOfAnother = ({ common, rig }, run) => run.on !== rig && (common.rigs ?? []).some((each) => each.rig === run.on);

// Runs of this rig, beside the one that is shown, that tripped and that nobody has acknowledged, by their journals. Where a
// station tells of such trips, it tells of all of them.
export function trippedRuns(link) {
  const { sections, common } = link;
  if (ofStation(sections.campaign) || unseenTrips(link).length) return [];
  return (common.launch?.unseen ?? []).filter((run) => run.reason === "a trip" && run.folder !== sections.campaign?.directory && !isOfAnother(link, run));
}
