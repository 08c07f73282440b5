"""The command line: one file a command, whose fields are its options.

Takes arguments and files; gives exit codes, tables and one JSON object. It holds no mechanics of its own.
"""
