/** The dialog of `identify`. */

/** Open the dialog. */
export function open(context) {
  context.notify("Use the command line: `piezod identify --help`.");
}
