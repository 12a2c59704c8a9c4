/** The dialog of `learn`. */

/** Open the dialog. */
export function open(context) {
  context.notify("Use the command line: `piezod play --help`.");
}
