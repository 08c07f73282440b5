"""The grasp as an artefact and its judge; nothing here knows how a grasp was found."""
