import pickle

from core.errors import ErrorCode, MeshmarkError


def test_an_error_survives_the_way_between_processes() -> None:
    error = MeshmarkError(ErrorCode.NO_FACES, "The file has no faces.", "Send a surface.")
    copy = pickle.loads(pickle.dumps(error))
    assert (copy.code, copy.message, copy.remedy) == (error.code, error.message, error.remedy)
    assert str(copy) == "no_faces: The file has no faces. Send a surface."


def test_codes_are_snake_case_and_equal_to_their_names() -> None:
    assert all(code.value == code.name.lower() for code in ErrorCode)
