"""Importer of ClaymoreUW scenes.

`parse` turns either dialect, or a HydroUQ workflow file, into the plain records of `records`;
`materials`, `geometry`, `boundaries` and `sensors` turn records into values of the library, and
`build` puts those into a scene. What is said about a file on the way is kept in a `Context`.
"""
