from studies import rendered_corners

rendered_corners.STUDY.run(rendered_corners.__doc__)
