from studies import board_shape

board_shape.STUDY.run(board_shape.__doc__)
