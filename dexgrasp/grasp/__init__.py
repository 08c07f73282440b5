"""The grasp as an artefact: what it is, its file, its picture; nothing here knows how one is found or judged."""
